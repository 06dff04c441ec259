"""The command line: parsing of options, one function for each command, and reports."""
