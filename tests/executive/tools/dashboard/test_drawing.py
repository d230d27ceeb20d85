"""Trees drawn as text and as SVG."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from pomona.executive.language import read
from pomona.tools.dashboard.drawing import show_svg, show_text

HEAD = "pomona: 1\ntree: t\n"


class TestText:
    def test_the_tree_reads_like_its_file(self, pick_apple):
        lines = show_text(read(pick_apple, "t.yaml"), width=100).splitlines()
        assert lines[0] == "pick_apple  Pick one fruit from the table and hold it above its place."
        assert lines[1] == "→ sequence"
        assert lines[2] == "├─ ▣ perceive  fruit: {fruit}, measured: {measured} · retry {looks}"
        assert lines[3] == "│  └─ → sequence"
        assert lines[4] == "│     ├─ ● MoveTo  pose: observe, variation: {retry.attempt}"
        assert lines[-1] == "   └─ ● on failure: Retreat  # before the next try"
        assert all(len(line) <= 100 for line in lines)

    def test_a_subtree_that_calls_itself_is_drawn_once(self):
        text = show_text(
            read(HEAD + "root: {a: {}}\nsubtrees: {a: {root: {sequence: [{a: {}}]}}}", "t.yaml")
        )
        assert text.count("▣ a") == 2

    def test_a_broken_file_draws_its_readable_part(self):
        assert show_text(read("[", "t.yaml")) == ""


class TestSvg:
    def test_it_is_well_formed_and_holds_every_node(self, pick_apple):
        root = ElementTree.fromstring(show_svg(read(pick_apple, "t.yaml")))
        text = " ".join(root.itertext())
        assert all(name in text for name in ("Detect", "SampleGrasp", "Attempt", "Retreat"))

    def test_no_two_boxes_overlap_and_all_lie_in_the_picture(self, pick_apple):
        root = ElementTree.fromstring(show_svg(read(pick_apple, "t.yaml")))
        width, height = (float(root.get(name, "0")) for name in ("width", "height"))
        tag = "{http://www.w3.org/2000/svg}"
        boxes = [
            tuple(float(rect.get(name, "0")) for name in ("x", "y", "width", "height"))
            for group in root.iter(f"{tag}g")
            for rect in group.findall(f"{tag}rect")[-1:]
        ]
        assert len(boxes) > 15
        assert all(x >= 0 and x + w <= width and y >= 0 and y + h <= height for x, y, w, h in boxes)
        for i, (x, y, w, h) in enumerate(boxes):
            for x2, y2, w2, h2 in boxes[i + 1 :]:
                assert x + w <= x2 or x2 + w2 <= x or y + h <= y2 or y2 + h2 <= y

    def test_shortened_text_stands_in_the_title(self):
        ports = ", ".join(f"port_{n}: 1" for n in range(12))
        svg = show_svg(read(HEAD + f"root: {{Beep: {{{ports}}}}}", "t.yaml"))
        assert "…" in svg
        assert f"<title>Beep\n{ports}</title>" in svg

    def test_names_cannot_break_out(self):
        name = "<script>alert(1)</script>"
        svg = show_svg(
            read(HEAD + f"root: {{Beep: {{}}, name: '{name.replace('/', '')}'}} # --><b>", "t.yaml")
        )
        ElementTree.fromstring(svg)
        assert "<script" not in svg
