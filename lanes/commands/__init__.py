"""One module a command: its docstring and EXAMPLES are its help, `add_arguments(parser)` its options, `run` its work.

`lanes.__main__` lists the commands and imports only the one that is asked for; they import what is slow inside `run`.
"""
