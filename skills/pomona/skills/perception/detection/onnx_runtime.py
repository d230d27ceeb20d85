"""The compact detector outside of torch: both networks as ONNX files, and a detector that ONNX Runtime carries out."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from pomona.executive.values.plain_text import read_plain_text
from pomona.skills.perception.detection.compact_detector import (
    CLOSE_LOOK_EXAMPLE,
    FINDER_EXAMPLE,
    CompactDetector,
    Run,
)
from pomona.skills.perception.detection.errors import BadWeights, MissingPackage
from pomona.skills.perception.detection.options import DetectorOptions
from pomona.skills.perception.detection.scores import ScoreMap
from pomona.skills.perception.detection.weights import load_compact, load_scores

FINDER, CLOSE_LOOK, ABOUT = "finder.onnx", "close_look.onnx", "about.json"

OPSET = 18


def export_onnx(weights: Path, folder: Path) -> tuple[Path, Path]:
    """Write a weights file's networks as ONNX files.

    Inputs are `picture`, float32 (n, 3, h, w), RGB in 0..1 minus 0.5; the finder's h and w are multiples of 16, the
    close look's 96. Outputs are those of `FinderNetwork` and `CloseLookNetwork`. What the weights say about themselves
    and the map of their scores are in about.json.

    Args:
        weights: of the compact detector.
        folder: made when missing.

    Raises:
        BadWeights: unreadable or not fitting.
        MissingPackage: without the package onnx.
    """
    finder, close_look, about = load_compact(weights)
    scores = load_scores(weights)
    outputs = ["belief", "offsets", "reaches"][: 3 if finder.boxes else 2]
    folder.mkdir(parents=True, exist_ok=True)
    paths = folder / FINDER, folder / CLOSE_LOOK
    sizes = {0: "n", 2: "h", 3: "w"}
    _export(finder, FINDER_EXAMPLE, outputs, dict.fromkeys(("picture", *outputs), sizes), paths[0])
    _export(close_look, CLOSE_LOOK_EXAMPLE, ["look"], {"picture": {0: "n"}, "look": {0: "n"}}, paths[1])
    said = {"about": about, "scores": {"slope": scores.slope, "offset": scores.offset}}
    (folder / ABOUT).write_text(json.dumps(said, indent=2) + "\n", encoding="utf-8")
    return paths


def _export(
    network: nn.Module, example: tuple[int, ...], outputs: list[str], free: dict[str, dict[int, str]], path: Path
) -> None:
    part = path.with_suffix(".part")
    with warnings.catch_warnings():
        # The exporter by tracing is announced to go; the other one needs one package more and gives the same graph.
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            torch.onnx.export(
                network.eval(),
                (torch.zeros(example),),
                part,
                input_names=["picture"],
                output_names=outputs,
                dynamic_axes=free,
                opset_version=OPSET,
                dynamo=False,
            )
        except torch.onnx.errors.OnnxExporterError as error:
            if "not installed" in str(error):
                raise MissingPackage("onnx", "writes ONNX files") from error
            raise
    part.replace(path)


def load_onnx(folder: Path, options: DetectorOptions | None = None) -> CompactDetector:
    """The detector whose networks `export_onnx` wrote, carried out by ONNX Runtime in one thread.

    Raises:
        BadWeights: no such files, or files that ONNX Runtime cannot read.
        MissingPackage: without the package onnxruntime.
    """
    finder, close_look = _session(folder / FINDER), _session(folder / CLOSE_LOOK)
    try:
        said = json.loads(read_plain_text(folder / ABOUT))["scores"]
        scores = ScoreMap(float(said["slope"]), float(said["offset"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise BadWeights(folder / ABOUT, f"does not say what the scores mean: {error!r}") from error
    return CompactDetector.running(finder, close_look, options, scores)


def _session(path: Path) -> Run:
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingPackage("onnxruntime", "carries out ONNX files") from error
    if not path.is_file():
        raise BadWeights(path, "no such file: `pomona export-weights --onnx` writes it")
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = settings.inter_op_num_threads = 1
    try:
        session: Any = onnxruntime.InferenceSession(str(path), settings, providers=["CPUExecutionProvider"])
    except Exception as error:  # its own errors have no common root
        raise BadWeights(path, f"cannot be read as an ONNX file: {type(error).__name__}") from error

    def carry_out(pictures: Tensor) -> Any:
        given = np.ascontiguousarray(pictures.numpy())
        parts = [torch.from_numpy(part) for part in session.run(None, {"picture": given})]
        return parts if len(parts) > 1 else parts[0]

    return carry_out
