"""Bad input gives findings, never a traceback and never a hang."""

from __future__ import annotations

import contextlib
import importlib.util
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings, strategies as st

from pomona.executive.language import TreeFileError, build, check, format_findings, read
from pomona.executive.language.expression import ExpressionSyntaxError, parse_expression
from pomona.executive.language.read import read_file
from pomona.executive.skill_testing import BenchContext
from pomona.executive.values import yaml_nodes
from pomona.tools.groot.export_xml import export_groot

SPEC = importlib.util.spec_from_file_location("fuzz", Path(__file__).with_name("fuzz.py"))
fuzzer = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(fuzzer)
SKILLS = fuzzer.dummy_skills()


@pytest.mark.slow
def test_mutated_trees(skills, pick_apple):
    trees = [pick_apple, *fuzzer.installed_trees()]
    assert fuzzer.fuzz(2000, 1, trees, skills, lambda text: fuzzer.try_tree(text, skills)) == []


def test_mutated_scenarios(skills, pick_apple, tmp_path):
    (tmp_path / "tree.yaml").write_text(
        "pomona: 1\ntree: t\nroot: {sequence: [{MoveTo: {pose: a}}, {Beep: {}}]}"
    )
    scenario = (
        "pomona: 1\ntree: tree.yaml\nmocks: {MoveTo: [{code: NO_PATH, calls: 2}, success]}\ncases:\n"
        "  - {name: one, expect: {code: NO_PATH}, visits: [MoveTo], never: [Beep], calls: {MoveTo: 1}, limit: 1 s}\n"
    )
    assert (
        fuzzer.fuzz(
            300, 2, [scenario], skills, lambda text: fuzzer.try_scenario(text, skills, tmp_path)
        )
        == []
    )


def test_mutated_xml(skills, pick_apple):
    xml = export_groot(read(pick_apple, "t.yaml"), skills)
    assert fuzzer.fuzz(500, 3, [xml], skills, fuzzer.try_xml) == []


@given(st.text(max_size=200))
@settings(max_examples=300)
def test_any_text_is_read(text):
    format_findings(read(text, "t.yaml").findings)


@given(st.lists(st.sampled_from([*fuzzer.TOKENS, "{a}", "a", "1", "'x'", "."]), max_size=30))
@settings(max_examples=500)
def test_any_expression_is_parsed_or_refused(tokens):
    with contextlib.suppress(ExpressionSyntaxError):
        parse_expression(" ".join(tokens))


names = st.sampled_from(["MoveTo", "Detect", "Refine", "Beep", "sub", "other"])
values = st.sampled_from(
    ["1", "a", "3 s", '"{x}"', '"{y.index}"', "true", "[1, 2]", "{a: b}", '"{retry.attempt} + 1"']
)
ports = st.dictionaries(
    st.sampled_from(["pose", "fruit", "detection", "measured", "times", "x"]), values, max_size=3
)
conditions = st.sampled_from(
    ['"{x} > 1"', '"failure.code == NO_PATH"', '"{y} == none"', '"1 < 2"', '"{x}"']
)
modifiers = st.dictionaries(
    st.sampled_from(
        [
            "retry",
            "timeout",
            "repeat",
            "when",
            "guard",
            "invert",
            "force",
            "for_each",
            "retry_if",
            "name",
        ]
    ),
    st.one_of(values, conditions, st.sampled_from(["success", "forever"])),
    max_size=3,
)


def flow(pairs):
    return "{" + ", ".join(f"{key}: {value}" for key, value in pairs.items()) + "}"


leaves = st.one_of(
    st.builds(lambda name, given, more: flow({name: flow(given), **more}), names, ports, modifiers),
    st.builds(lambda condition, more: flow({"check": condition, **more}), conditions, modifiers),
    st.builds(lambda given: flow({"set": flow(given)}), ports),
)
nodes = st.recursive(
    leaves,
    lambda children: st.builds(
        lambda kind, inner, more: flow({kind: f"[{', '.join(inner)}]", **more}),
        st.sampled_from(
            [
                "sequence",
                "fallback",
                "parallel",
                "reactive_sequence",
                "reactive_fallback",
                "recovery",
            ]
        ),
        st.lists(children, min_size=1, max_size=4),
        modifiers,
    ),
    max_leaves=12,
)


@pytest.mark.slow
@given(root=nodes, sub=nodes)
@settings(max_examples=300)
def test_any_tree_is_checked_and_a_right_one_is_built_and_runs(root, sub):
    head = "pomona: 1\ntree: t\nparameters: {x: {type: int, default: 1}}"
    document = read(f"{head}\nroot: {root}\nsubtrees: {{sub: {{root: {sub}}}}}", "t.yaml")
    findings = check(document, SKILLS)
    context = BenchContext()
    try:
        tree = build(document, SKILLS, context=context)
    except TreeFileError:
        assert any(finding.severity == "error" for finding in findings)
        return
    for _ in range(20):
        tree.root.tick_once()
        context.clock.advance(0.5)


class TestHostileFiles:
    def codes(self, text):
        return [finding.code for finding in read(text, "t.yaml").findings]

    def test_alias_bomb(self):
        pairs = zip("abcdefgh", "bcdefghi", strict=True)
        bomb = "a: &a [x, x]\n" + "".join(
            f"{name}: &{name} [*{before}, *{before}]\n" for before, name in pairs
        )
        assert self.codes(bomb) == ["alias"]

    def test_an_alias_of_itself(self):
        assert self.codes("root: &a [*a]") == ["alias"]

    def test_tags(self):
        assert self.codes("root: !!python/object/apply:os.system [ls]") == ["tag"]

    def test_a_large_file(self):
        assert self.codes("# " + "x" * 600_000) == ["too-large"]

    @pytest.mark.parametrize("text", ["[" * 5000, "{a: " * 5000, "- " * 5000, "? " * 3000])
    def test_deep_nesting(self, text):
        assert self.codes(text) == ["too-deep"]

    @pytest.mark.parametrize("loader", ["CSafeLoader", "SafeLoader"])
    def test_deep_nesting_is_found_at_the_same_place_by_both_parsers(self, monkeypatch, loader):
        monkeypatch.setattr(yaml_nodes, "LOADER", getattr(yaml, loader))
        (finding,) = read('a: "[["\n# [[[\nb: [ ]\nc: ' + "[" * 5000, "t.yaml").findings
        assert (finding.code, finding.line, finding.column) == ("too-deep", 4, 84)

    def test_an_unclosed_list_is_not_reported_as_deep_nesting(self):
        assert self.codes("[" * 60 + '"' + "[" * 60) == ["yaml"]

    def test_many_values(self):
        assert self.codes("[" + "1," * 150_000 + "1]") == ["too-large"]

    def test_a_file_outside_the_trees_folder(self, tmp_path, skills):
        (tmp_path / "trees").mkdir()
        (tmp_path / "secret.yaml").write_text("pomona: 1\ntree: s\nroot: {Beep: {}}")
        (tmp_path / "trees" / "link.yaml").symlink_to(tmp_path / "secret.yaml")
        for name in (
            "../secret.yaml",
            str(tmp_path / "secret.yaml"),
            "link.yaml",
            "/dev/zero",
            "/proc/self/environ",
        ):
            text = f"pomona: 1\ntree: t\nroot: {{s: {{}}}}\nsubtrees: {{s: {{file: {name}}}}}"
            (tmp_path / "trees" / "t.yaml").write_text(text)
            document = read_file(tmp_path / "trees" / "t.yaml")
            assert [f.code for f in document.findings] == ["file"], name
            assert "outside the tree's folder" in document.findings[0].message

    @pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"\x00" * 10, b"\xed\xa0\x80"])
    def test_bytes_that_are_no_text(self, tmp_path, content):
        (tmp_path / "t.yaml").write_bytes(content)
        assert len(read_file(tmp_path / "t.yaml").findings) == 1

    def test_files_that_cannot_be_opened(self, tmp_path):
        for path in (tmp_path, tmp_path / "none.yaml", Path("/dev/null"), Path("a\0b")):
            assert [f.code for f in read_file(path).findings] == ["file"]


class TestOtherFiles:
    def write(self, folder, **files):
        for name, text in files.items():
            (folder / f"{name}.yaml").write_text(text)
        return folder / "main.yaml"

    MAIN = "pomona: 1\ntree: main\nroot: {look: {far: 2 cm, found: '{d}'}}\nsubtrees: {look: {file: look.yaml}}"
    LOOK = (
        "pomona: 1\ntree: look_around\nparameters: {far: {type: length, default: 1 cm}}\nout: {found: detection}\n"
        "root:\n  sequence:\n    - back: {}\n    - Detect: {fruit: apple, detection: '{found}'}\n"
        "subtrees: {back: {root: {Retreat: {distance: '{far}'}}}}"
    )

    def test_parameters_of_a_called_file_are_its_inputs(self, tmp_path, skills):
        document = read_file(self.write(tmp_path, main=self.MAIN, look=self.LOOK))
        assert [f.code for f in check(document, skills)] == ["unread"]
        context = BenchContext()
        tree = build(document, skills, context=context)
        for _ in range(10):
            tree.root.tick_once()
        assert tree.behaviours["main/sequence/back/Retreat"].seen["distance"] == pytest.approx(0.02)
        assert tree.board.get("/d") is not None

    def test_findings_name_the_file(self, tmp_path, skills):
        path = self.write(tmp_path, main=self.MAIN, look=self.LOOK.replace("Detect", "Detekt"))
        (found,) = [f for f in check(read_file(path), skills) if f.severity == "error"]
        assert found.path.endswith("look.yaml")
        assert found.line == 8

    def test_files_that_call_each_other(self, tmp_path, skills):
        look = "pomona: 1\ntree: look\nroot: {main: {}}\nsubtrees: {main: {file: main.yaml}}"
        main = "pomona: 1\ntree: main\nroot: {look: {}}\nsubtrees: {look: {file: look.yaml}}"
        path = self.write(tmp_path, main=main, look=look)
        assert [f.code for f in check(read_file(path), skills)] == ["recursion"]

    def test_installed_trees(self, tmp_path, skills):
        (tmp_path / "installed").mkdir()
        (tmp_path / "mine").mkdir()
        (tmp_path / "installed" / "look.yaml").write_text(self.LOOK)
        path = self.write(tmp_path / "mine", main=self.MAIN)
        assert [f.code for f in read_file(path).findings] == ["file"]
        assert read_file(path, tree_folders=[tmp_path / "installed"]).findings == []
