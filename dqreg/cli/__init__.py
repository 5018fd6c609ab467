"""The command line: arguments in, files and exit codes out; no arithmetic."""
