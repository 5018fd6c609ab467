"""``python -m dqreg``: the command ``dqreg``, where no script of that name is on the path."""

import sys

if __name__ == "__main__":
    # Python puts the working folder first. No module of the standard library is to be taken from there.
    if not sys.flags.safe_path:
        sys.path.append(sys.path.pop(0))
    from dqreg.cli.main import console

    console()
