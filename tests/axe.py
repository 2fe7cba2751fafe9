"""Accessibility findings of a page by axe-core, which `make axe` gets from npm."""

from __future__ import annotations

from pathlib import Path

FILE = Path(__file__).parents[1] / "build" / "axe" / "node_modules" / "axe-core" / "axe.min.js"
MISSING = "" if FILE.is_file() else "needs axe-core (make axe)"
GRAVE = ("serious", "critical")


def findings(browser) -> list[str]:
    """Serious findings of the page that a browser shows, one line each."""
    browser.run(FILE.read_text(encoding="utf-8") + "\nwindow.axe = axe;")
    found = browser.run("return axe.run(document, { resultTypes: ['violations'] }).then((r) => r.violations)")
    return [
        f"{one['id']}: {node['target']}: {node['failureSummary']}"
        for one in found
        if one["impact"] in GRAVE
        for node in one["nodes"]
    ]
