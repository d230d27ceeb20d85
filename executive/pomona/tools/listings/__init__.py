"""Lists of the installed skills and of the language, for people, editors and shells."""
