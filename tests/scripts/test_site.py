"""The documentation's site loads nothing from elsewhere: what its theme would fetch is in the repository."""

from __future__ import annotations

from pathlib import Path

from mkdocs.config import load_config

ROOT = Path(__file__).resolve().parents[2]


def test_the_search_in_pages_from_the_disk_needs_no_network() -> None:
    config = load_config(str(ROOT / "mkdocs.yml"))
    plugin = config.plugins["material/offline"]
    plugin.on_config(config)
    scripts = config.extra["polyfills"]
    assert any("iframe-worker" in script for script in scripts)
    assert [script for script in scripts if not (ROOT / "docs" / script).is_file()] == []
    assert config.theme["font"] is False
