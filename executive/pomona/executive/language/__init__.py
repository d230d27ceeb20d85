"""Tree files: YAML text → document → findings → py_trees tree."""

from pomona.executive.language.build import Mocks, build
from pomona.executive.language.built import BuiltTree, NodeInfo
from pomona.executive.language.check import check
from pomona.executive.language.model import Document
from pomona.executive.language.read import read, read_file
from pomona.executive.values.findings import Finding, TreeFileError, format_finding, format_findings

__all__ = [
    "BuiltTree",
    "Document",
    "Finding",
    "Mocks",
    "NodeInfo",
    "TreeFileError",
    "build",
    "check",
    "format_finding",
    "format_findings",
    "read",
    "read_file",
]
