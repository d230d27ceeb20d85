"""JSON Schemas of tree files and other kinds of files, for editors."""
