"""The command line: each command parses, prints and writes; the work is done elsewhere.

A new command is a module with a function of its own, registered in `fuzzykf.cli.app`.
"""
