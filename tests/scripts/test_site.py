"""The documentation's site: it loads nothing from elsewhere, draws trees and formulas, and can be read."""

from __future__ import annotations

import re
from pathlib import Path

from markdown import markdown
from mkdocs.config import load_config

from pomona.executive.nodes import NodeTypes
from pomona.tools.dashboard.drawing import show_text
from scripts.mathml import on_page_content
from scripts.node_examples import EXAMPLES, beside, document_of
from scripts.site_hooks import on_page_content as clean_page, on_page_markdown, on_post_template
from tests.executive.tools.dashboard.test_contrast import contrast

ROOT = Path(__file__).resolve().parents[2]


def test_the_search_in_pages_from_the_disk_needs_no_network() -> None:
    config = load_config(str(ROOT / "mkdocs.yml"))
    plugin = config.plugins["material/offline"]
    plugin.on_config(config)
    scripts = config.extra["polyfills"]
    assert any("iframe-worker" in script for script in scripts)
    assert [script for script in scripts if not (ROOT / "docs" / script).is_file()] == []
    assert config.theme["font"] is False


def test_every_word_of_the_language_has_an_example_that_reads_and_is_drawn() -> None:
    words = [
        node.key
        for node in NodeTypes.installed().values()
        if type(node).__module__.startswith("pomona.")
    ]
    assert sorted(EXAMPLES) == sorted(words)
    for word in words:
        document = document_of(word)
        assert [found.message for found in document.findings if found.severity == "error"] == [], (
            word
        )
        assert word in show_text(document)
        assert "<svg" in beside(word)


def test_no_column_has_an_empty_header() -> None:
    html = markdown("| | mm |\n|---|---|\n| error | 1 |\n", extensions=["tables"])
    assert re.search(r"<th[^>]*></th>", html)
    assert not re.search(r"<th[^>]*></th>", clean_page(html))


def test_the_search_dialogue_of_the_page_404_has_a_name() -> None:
    config = load_config(str(ROOT / "mkdocs.yml"))
    source = (Path(config.theme.dirs[0]) / "partials" / "search.html").read_text("utf-8")
    (dialogue,) = re.findall(
        r'<div class="md-search"[^>]*>', on_post_template(source, template_name="404.html")
    )
    assert 'aria-label="Search"' in dialogue


def test_words_come_from_their_classes_and_whole_trees_are_drawn() -> None:
    page = on_page_markdown((ROOT / "docs" / "tree_language.md").read_text("utf-8"))
    assert "| `retry`, " in page, "a table of words comes from the classes"
    assert "{words:" not in page
    assert '<figure tabindex="0"><svg' in page


def test_a_link_out_of_the_site_becomes_a_path_in_the_repository() -> None:
    leaf = "executive/pomona/tools/dashboard/live_stream.md"
    assert on_page_markdown(f"[stream](../{leaf})") == f"`{leaf}`"
    assert (
        on_page_markdown(f"[format of the stream](../{leaf}#what)")
        == f"format of the stream (`{leaf}`)"
    )


def test_formulas_are_drawn_without_a_mathematical_font() -> None:
    html = on_page_content(
        r'<div class="arithmatex">\[\hat{\mathbf p}=\begin{bmatrix}a\\ b\end{bmatrix}\]</div>'
    )
    assert '<mtable class="bracketed">' in html
    assert "&#x0005B;" not in html
    assert "\U0001d429" in html


def test_a_prime_stands_beside_its_letter_and_the_variable_of_a_minimum_below_it() -> None:
    html = on_page_content(r"""<div class="arithmatex">\[\min_\sigma \hat d'_{ij}+p'\]</div>""")
    assert html.count('<mo lspace="0" rspace="0">\N{PRIME}</mo>') == 2
    assert "<munder><mo>min</mo>" in html
    assert "msubsup" not in html


def test_words_stand_out_on_the_site() -> None:
    style = (ROOT / "docs" / "assets" / "site.css").read_text("utf-8")
    schemes = dict(re.findall(r'\[data-md-color-scheme="(\w+)"\] \{(.*?)\}', style, re.DOTALL))
    for scheme, ground in (("default", "#ffffff"), ("slate", "#1e2129")):
        colours = dict(re.findall(r"--md-([\w-]+): (#[0-9a-f]+);", schemes[scheme]))
        for name in ("typeset-a-color", "accent-fg-color", "default-fg-color--light"):
            assert contrast(colours[name], ground) >= 4.5, (scheme, name)
        assert contrast("#ffffff", colours["primary-fg-color"]) >= 4.5
