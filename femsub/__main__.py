"""`python -m femsub` is the command `femsub`."""

from __future__ import annotations

import sys


def main() -> int:
    """Runs `femsub.app.cli.main`. Ctrl-C during its import ends with one line too, not with a traceback."""
    try:
        from femsub.app.cli import main as command

        return command()
    except KeyboardInterrupt:
        print("femsub: interrupted; nothing was written", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
