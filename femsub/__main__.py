"""`python -m femsub` is the command `femsub`."""

from __future__ import annotations

import sys


def main() -> int:
    """`femsub.app.cli.main`; Ctrl-C while it is imported ends with one line as well."""
    try:
        from femsub.app.cli import main as command

        return command()
    except KeyboardInterrupt:
        print("femsub: interrupted; nothing was written", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
