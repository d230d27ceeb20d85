"""Tree files: YAML text → document → findings → py_trees tree."""

from executive.tree_file.build import Mocks, build
from executive.tree_file.built import BuiltTree, NodeInfo
from executive.tree_file.check import check
from executive.tree_file.findings import Finding, TreeFileError, format_finding, format_findings
from executive.tree_file.model import Document
from executive.tree_file.read import read, read_file

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
