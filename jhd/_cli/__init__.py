"""The command line: parsing of options, one handler for each command, reports."""
