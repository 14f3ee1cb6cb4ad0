"""`python -m lanes COMMAND`."""

from lanes.cli import installed_command

if __name__ == "__main__":
    installed_command()
