"""Where Chromium is. Tests that need it are skipped without it; with REQUIRE_CHROMIUM set, as by .ci/run, they fail."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

MISSING = "there is no Chromium; run: apt-get install chromium"
NAMES = ("chromium", "chromium-browser", "google-chrome")
PLAYWRIGHTS = Path.home() / ".cache" / "ms-playwright"  # `playwright install chromium` puts it there


def find() -> str | None:
    """Path of the Chromium of the system, else of the newest one of Playwright; None where there is none."""
    own = sorted(PLAYWRIGHTS.glob("chromium-*/chrome-linux*/chrome"))
    return next(filter(None, map(shutil.which, NAMES)), str(own[-1]) if own else None)


CHROMIUM = find()
if CHROMIUM is None and os.environ.get("REQUIRE_CHROMIUM"):
    raise RuntimeError(MISSING)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)
