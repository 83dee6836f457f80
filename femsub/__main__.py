"""`python -m femsub` is the command `femsub`."""

from __future__ import annotations

import sys

from femsub.app.cli import main

sys.exit(main())
