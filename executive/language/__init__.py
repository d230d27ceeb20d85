"""Tree files: YAML text → document → findings → py_trees tree."""

from executive.language.build import Mocks, build
from executive.language.built import BuiltTree, NodeInfo
from executive.language.check import check
from executive.language.model import Document
from executive.language.read import read, read_file
from executive.values.findings import Finding, TreeFileError, format_finding, format_findings

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
