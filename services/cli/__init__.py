"""The command line: one thin file for each group of verbs, and beside it, `verb_...`, what it alone needs."""
