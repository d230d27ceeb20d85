"""The editor in a browser: keyboard alone, mouse, undo, conflicts, drafts, findings, runs, and a narrow window."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from pomona.tools.tree_editor.server import TreeEditor
from tests.executive.tools.tree_editor.conftest import SMALL

pytestmark = pytest.mark.browser

AXE = Path(__file__).parents[1] / "dashboard" / "vendor" / "axe.min.js"
FOUND = """async () => (await axe.run(document, { resultTypes: ["violations"] })).violations
    .map((found) => `${found.id}: ${found.nodes.slice(0, 3).map((node) => node.html.slice(0, 160)).join(" | ")}`)"""

Open = Callable[..., Any]


def expect(locator: Any) -> Any:
    from playwright.sync_api import expect as playwright_expect

    return playwright_expect(locator)


def item(page: Any, address: str) -> Any:
    return page.locator(f'.item[data-id="{address}"]')


def choose(page: Any, key: str, word: str) -> None:
    """Press a key that opens the palette, and choose a word with the keyboard."""
    page.keyboard.press(key)
    expect(page.locator("#palette")).to_be_visible()
    page.keyboard.type(word)
    expect(page.locator('#palette-list [aria-selected="true"] b')).to_have_text(word)
    page.keyboard.press("Enter")


def area(page: Any) -> Any:
    return page.locator("#area")


def test_a_tree_is_built_from_an_empty_file_with_the_keyboard_alone(
    make_editor: Callable[[Path], TreeEditor], tree: Path, open_page: Open
) -> None:
    """Look, measure, pick with three tries, else ask."""
    path = tree.parent / "new.yaml"
    page = open_page(make_editor(path))
    keys = page.keyboard
    choose(page, "i", "fallback")
    expect(item(page, "root")).to_have_attribute("aria-selected", "true")
    choose(page, "a", "sequence")
    expect(item(page, "root/0")).to_have_attribute("aria-selected", "true")
    choose(page, "a", "MoveTo")
    expect(item(page, "root/0/0")).to_be_visible()
    keys.press("Enter")
    expect(page.locator("#field-port-pose")).to_be_focused()
    keys.type("observe")
    keys.press("Enter")
    expect(area(page)).to_have_value("""pomona: 1
tree: new

root:
  fallback:
    - sequence:
        - MoveTo: {pose: observe}
""")
    keys.press("Escape")
    expect(page.locator("#tree")).to_be_focused()
    for number, word in enumerate(("Detect", "Refine"), start=1):
        choose(page, "i", word)
        expect(item(page, f"root/0/{number}")).to_have_attribute("aria-selected", "true")
    keys.press("ArrowLeft")
    choose(page, "m", "retry")
    expect(page.locator("#field-modifier-retry")).to_be_focused()
    keys.press("Escape")
    choose(page, "i", "ask")
    expect(item(page, "root/1")).to_have_attribute("aria-selected", "true")
    expect(page.locator("#problems")).to_contain_text("1 error")  # no question stands there yet
    keys.press("Enter")
    keys.type("Is it held?")
    keys.press("Enter")
    expect(page.locator("#problems")).not_to_contain_text("error")
    keys.press("Control+s")
    expect(page.locator("#saved")).to_have_text("saved")
    assert (
        path.read_text()
        == """pomona: 1
tree: new

root:
  fallback:
    - sequence:
        - MoveTo: {pose: observe}
        - Detect: {fruit: apple, detection: "{detection}"}
        - Refine: {detection: "{detection}", measured: "{measured}"}
      retry: 3
    - ask: Is it held?
"""
    )


def test_the_palette_names_the_key_for_an_entry_that_is_in_another_one(
    editor: TreeEditor, open_page: Open
) -> None:
    page = open_page(editor)
    page.keyboard.press("ArrowDown")
    page.keyboard.press("i")
    page.keyboard.type("retry")
    expect(page.locator("#palette-list")).to_contain_text(
        "retry is among the others: Esc, then m at a node."
    )
    page.locator("#palette-search").fill("measure")
    expect(page.locator('#palette-list [role="option"] small').first).to_contain_text("Measure")


PLAIN = {
    "look": "Detect", "see": "Detect", "find": "Detect", "measure": "Refine", "wait": "wait", "wait until": "wait_until",
    "pause": "wait", "try again": "retry", "repeat": "repeat", "loop": "repeat", "if": "if", "else": "fallback",
    "choose": "ChooseFruit", "grab": "SlipAvoidGrasp", "grip": "SlipAvoidGrasp", "pick up": "Lift", "lift": "Lift",
    "put down": "Release", "let go": "Release", "move": "MoveTo", "go home": "MoveTo", "ask": "ask", "stop": "fail",
    "camera": "Detect", "squeeze": "SlipAvoidGrasp", "drop": "Release", "sleep": "wait", "sort": "ChooseFruit",
}  # fmt: skip
"""Plain words, and the node that each means."""


def test_the_palette_finds_a_node_by_a_plain_word_among_the_first_three(
    editor: TreeEditor, open_page: Open
) -> None:
    page = open_page(editor)
    page.keyboard.press("ArrowDown")
    page.keyboard.press("i")
    missed = {}
    for word, node in PLAIN.items():
        page.locator("#palette-search").fill(word)
        others = page.locator("#palette-list > p b").all_inner_texts()
        first = [*others, *page.locator('#palette-list [role="option"] b').all_inner_texts()][:4]
        if node not in first:
            missed[word] = first
    assert missed == {}


def drawn_out(page: Any, word: str, x: float, y: float) -> None:
    """Drag a word out of the palette to a place."""
    page.keyboard.press("i")
    expect(page.locator("#palette")).to_be_visible()
    page.keyboard.type(word)
    box = page.locator('#palette-list [aria-selected="true"]').bounding_box()
    page.mouse.move(box["x"] + 40, box["y"] + 8)
    page.mouse.down()
    page.mouse.move(box["x"] + 60, box["y"] + 20, steps=3)
    expect(page.locator("#palette")).to_be_hidden()
    page.mouse.move(x, y + 20, steps=5)
    page.mouse.move(x, y, steps=3)


def test_a_node_is_dragged_out_of_the_palette(
    editor: TreeEditor, open_page: Open, tree: Path
) -> None:
    page = open_page(editor)
    target = item(page, "root/0").bounding_box()
    drawn_out(page, "fallback", target["x"] + 60, target["y"] + 4)
    expect(page.locator(".drop")).to_be_visible()
    page.mouse.up()
    expect(item(page, "root/0")).to_contain_text("fallback")
    expect(item(page, "root/0")).to_have_attribute("aria-selected", "true")
    expect(area(page)).to_have_value(SMALL.replace("    - wait", "    - fallback: []\n    - wait"))
    drawn_out(page, "fallback", target["x"] + 60, target["y"] + 4)
    page.keyboard.press("Escape")
    page.mouse.up()
    box = page.locator("#area").bounding_box()
    drawn_out(page, "fallback", box["x"] + 60, box["y"] + 60)
    page.mouse.up()
    page.keyboard.press("Control+z")
    expect(area(page)).to_have_value(SMALL)
    expect(page.locator("#undo")).to_be_disabled()


def test_a_node_is_dragged_and_undo_returns_the_bytes(
    editor: TreeEditor, open_page: Open, tree: Path
) -> None:
    page = open_page(editor)
    source, target = (
        item(page, "root/2").locator(".box").bounding_box(),
        item(page, "root/0").bounding_box(),
    )
    page.mouse.move(source["x"] + 20, source["y"] + 10)
    page.mouse.down()
    page.mouse.move(target["x"] + 60, target["y"] + 20, steps=5)
    page.mouse.move(target["x"] + 60, target["y"] + 4, steps=3)
    expect(page.locator(".drop")).to_be_visible()
    page.mouse.up()
    moved = SMALL.replace('    - check: "{done}"\n', "").replace(
        "    - wait", '    - check: "{done}"\n    - wait'
    )
    expect(area(page)).to_have_value(moved)
    expect(item(page, "root/0")).to_have_attribute("aria-selected", "true")
    page.keyboard.press("Control+z")
    expect(area(page)).to_have_value(SMALL)
    page.keyboard.press("Control+y")
    expect(area(page)).to_have_value(moved)
    page.keyboard.press("Control+z")
    expect(page.locator("#saved")).to_have_text("saved")
    assert tree.read_text() == SMALL


def test_every_edit_of_the_menu_is_undone_to_the_same_bytes(
    editor: TreeEditor, open_page: Open
) -> None:
    page = open_page(editor)
    edits = [
        ("d", ""),
        ("Delete", ""),
        ("Alt+ArrowDown", ""),
        ("w", "fallback"),
        ("m", "timeout"),
        ("i", "succeed"),
    ]
    for key, word in edits:
        item(page, "root/0").locator(".box").click()
        page.locator("#tree").focus()
        choose(page, key, word) if word else page.keyboard.press(key)
        expect(area(page)).not_to_have_value(SMALL)
        page.locator("#tree").focus()
        page.keyboard.press("Control+z")
        expect(area(page)).to_have_value(SMALL)


def test_nodes_are_copied_cut_and_pasted_with_keys_and_undone_to_the_same_bytes(
    editor: TreeEditor, open_page: Open
) -> None:
    page = open_page(editor, permissions=["clipboard-read", "clipboard-write"])
    keys = page.keyboard
    item(page, "root/1").locator(".box").click()
    page.locator("#tree").focus()
    keys.press("Control+c")
    keys.press("Control+v")
    expect(page.get_by_role("treeitem")).to_have_count(5)
    expect(item(page, "root/2")).to_have_attribute("aria-selected", "true")
    pasted = area(page).input_value()
    expect(page.locator("#problems")).not_to_contain_text("error")
    keys.press("Control+x")
    expect(area(page)).to_have_value(SMALL)
    keys.press("ArrowUp")
    keys.press("Control+v")
    expect(page.get_by_role("treeitem")).to_have_count(5)
    for _ in range(2):
        keys.press("Control+z")
    expect(area(page)).to_have_value(pasted)
    keys.press("Control+z")
    expect(area(page)).to_have_value(SMALL)


def test_a_copy_with_a_name_gets_another_name_and_a_text_from_elsewhere_is_a_node(
    editor: TreeEditor, open_page: Open
) -> None:
    page = open_page(editor)
    paste = """(text) => { const data = new DataTransfer(); data.setData("text/plain", text);
        document.dispatchEvent(new ClipboardEvent("paste", { clipboardData: data, cancelable: true })); }"""
    item(page, "root/0").locator(".box").click()
    page.locator("#tree").focus()
    for number in (2, 3):
        page.evaluate(paste, "# a pause\nsequence:\n  - wait: 2 s\n    name: Pause")
        expect(page.locator("#tree [aria-selected=true]")).to_have_attribute(
            "data-id", f"root/{number - 1}"
        )
    text = area(page).input_value()
    assert (text.count("name: Pause\n"), text.count("name: Pause 2\n")) == (1, 1)
    assert text.count("# a pause") == 2
    page.evaluate(paste, "wait: [")
    expect(page.locator("#said")).to_contain_text("no YAML")
    assert area(page).input_value() == text


def test_the_context_menu_edits_the_node_under_the_pointer(
    editor: TreeEditor, open_page: Open
) -> None:
    page = open_page(editor)
    item(page, "root/1").locator(".box").click(button="right")
    expect(page.get_by_role("menu")).to_be_visible()
    page.get_by_role("menuitem", name="Duplicate").click()
    expect(page.get_by_role("treeitem")).to_have_count(5)
    expect(item(page, "root/2")).to_have_attribute("aria-selected", "true")


def test_text_and_drawing_are_edited_at_the_same_time(editor: TreeEditor, open_page: Open) -> None:
    page = open_page(editor)
    area(page).fill(SMALL.replace("wait: 1 s", "wait: 1 kg"))
    expect(item(page, "root/0")).to_have_class("item wrong")
    expect(page.locator("#findings li.error")).to_have_count(1)
    page.locator("#tree").focus()
    item(page, "root/0").locator(".box").click()
    page.locator("#field-port-wait").fill("3 s")
    page.locator("#field-port-wait").press("Enter")
    expect(area(page)).to_have_value(SMALL.replace("1 s", "3 s"))
    expect(page.locator("#findings li.error")).to_have_count(0)
    area(page).fill("root: [")
    expect(page.locator("#stale")).to_be_visible()
    expect(page.get_by_role("treeitem")).to_have_count(4)
    page.keyboard.press("Control+z")
    expect(page.locator("#stale")).to_be_hidden()


def test_a_hint_is_applied_with_a_click(editor: TreeEditor, open_page: Open) -> None:
    page = open_page(editor)
    area(page).fill(SMALL.replace("sequence:", "sequnce:"))
    page.get_by_role("button", name="Apply").first.click()
    expect(area(page)).to_have_value(SMALL)


def test_units_and_wires_are_chosen_beside_a_field(
    make_editor: Callable[[Path], TreeEditor], open_page: Open, tree: Path
) -> None:
    tree.write_text(
        "pomona: 1\ntree: a\nparameters:\n  long: {type: time, default: 1 s}\nroot:\n  sequence:\n    - wait: 1 s\n"
    )
    page = open_page(make_editor(tree))
    item(page, "root/0").locator(".box").click()
    offers = page.locator('select[data-port="wait"]')
    offers.select_option(label="ms")
    expect(area(page)).to_have_value(tree.read_text().replace("- wait: 1 s", "- wait: 1 ms"))
    expect(offers.locator("option", has_text="{long}")).to_have_count(1)
    offers.select_option(value="w{long}")
    expect(area(page)).to_have_value(tree.read_text().replace("- wait: 1 s", '- wait: "{long}"'))


def test_words_of_a_field_are_quoted_where_yaml_needs_it(
    make_editor: Callable[[Path], TreeEditor], open_page: Open, tree: Path
) -> None:
    tree.write_text(SMALL.replace("    - check", "    - wait: 2 s\n      when: x\n    - check"))
    page = open_page(make_editor(tree))
    item(page, "root/2").locator(".box").click()
    field = page.locator("#field-modifier-when")
    typed = {
        "done": "done",
        "done != 'moved'": "\"done != 'moved'\"",
        "'moved' == 'done'": "\"'moved' == 'done'\"",
        '"moved" == done': '"\\"moved\\" == done"',
        "[1] == [2]": '"[1] == [2]"',
        '"done"': '"done"',
        "null": '"null"',
    }
    for words, written in typed.items():
        field.fill(words)
        field.press("Enter")
        expect(area(page)).to_have_value(tree.read_text().replace("when: x", f"when: {written}"))
        expect(page.locator("#stale")).to_be_hidden()


def test_a_file_with_an_error_is_saved_and_not_run(
    editor: TreeEditor, open_page: Open, tree: Path
) -> None:
    page = open_page(editor)
    broken = SMALL.replace("wait: 1 s", "wait: 1 kg")
    area(page).fill(broken)
    expect(page.locator("#problems")).to_have_text("1 error")
    page.keyboard.press("Control+s")
    expect(page.locator("#saved")).to_have_text("saved")
    assert tree.read_text() == broken
    page.get_by_role("button", name="Dry run").click()
    expect(page.locator('[data-bar="trial"]')).to_contain_text("correct the errors first")


def test_a_fault_of_a_called_file_is_listed_with_its_place(
    editor: TreeEditor, open_page: Open, tree: Path
) -> None:
    tree.with_name("look.yaml").write_text("pomona: 1\ntree: look\nroot:\n  Beeep: {}\n")
    page = open_page(editor)
    area(page).fill(
        SMALL.replace("- wait: 1 s", "- look: {}") + "subtrees:\n  look: {file: look.yaml}\n"
    )
    expect(page.locator("#findings li.error")).to_contain_text(
        "look.yaml:4:3: no skill named 'Beeep'"
    )
    page.locator("#findings li.error").get_by_role("button", name="file", exact=True).click()
    page.get_by_role("button", name="Dry run").click()
    expect(page.locator('[data-bar="trial"]')).to_contain_text("look.yaml:4:3")


def test_a_change_on_disk_is_taken_over_or_shown_as_a_conflict(
    editor: TreeEditor, open_page: Open, tree: Path
) -> None:
    page = open_page(editor)
    theirs = SMALL.replace("1 s", "7 s")
    tree.write_text(theirs)
    expect(area(page)).to_have_value(theirs)
    area(page).fill(SMALL.replace("1 s", "8 s"))
    tree.write_text(SMALL.replace("1 s", "9 s"))
    conflict = page.locator('[data-bar="conflict"]')
    expect(conflict).to_contain_text("Changed on disk")
    page.keyboard.press("Control+s")
    expect(conflict).to_be_visible()
    assert tree.read_text() == SMALL.replace("1 s", "9 s")
    conflict.get_by_role("button", name="Take the disk's").click()
    expect(area(page)).to_have_value(SMALL.replace("1 s", "9 s"))
    page.keyboard.press("Control+z")
    expect(area(page)).to_have_value(SMALL.replace("1 s", "8 s"))
    page.keyboard.press("Control+s")
    expect(page.locator("#saved")).to_have_text("saved")
    assert tree.read_text() == SMALL.replace("1 s", "8 s")


def test_why_a_file_cannot_be_saved_is_shown_while_it_is_so(
    editor: TreeEditor, open_page: Open, tree: Path
) -> None:
    page = open_page(editor)
    area(page).fill(SMALL.replace("1 s", "8 s"))
    for name, spoil in {
        "readonly": lambda: tree.chmod(0o444),
        "gone": lambda: tree.write_text("#" * 10_000_000),
    }.items():
        spoil()
        expect(page.locator(f'[data-bar="{name}"]')).to_be_visible()
        expect(page.locator("#save")).to_be_disabled()
        tree.chmod(0o644)
        tree.write_text(SMALL)
        expect(page.locator(f'[data-bar="{name}"]')).to_have_count(0)
        expect(page.locator("#save")).to_be_enabled()


def test_two_pages_see_each_other_and_the_later_one_decides(
    editor: TreeEditor, open_page: Open, tree: Path
) -> None:
    one, two = open_page(editor), open_page(editor)
    expect(one.locator('[data-bar="others"]')).to_be_visible()
    area(two).fill(SMALL.replace("1 s", "2 s"))
    area(one).fill(SMALL.replace("1 s", "3 s"))
    one.keyboard.press("Control+s")
    expect(one.locator("#saved")).to_have_text("saved")
    conflict = two.locator('[data-bar="conflict"]')
    conflict.get_by_role("button", name="Keep mine").click()
    expect(conflict).to_have_count(0)
    two.keyboard.press("Control+s")
    expect(two.locator("#saved")).to_have_text("saved")
    assert tree.read_text() == SMALL.replace("1 s", "2 s")


def test_a_closed_browser_loses_nothing(editor: TreeEditor, open_page: Open, tree: Path) -> None:
    page, mine = open_page(editor), SMALL.replace("1 s", "6 s")
    with page.expect_response("**/api/draft"):
        area(page).fill(mine)
    page.reload()
    page.wait_for_selector("body[data-ready=yes]")
    expect(area(page)).to_have_value(mine)
    page.context.close()
    other = open_page(editor)  # at once: the first page is not known to be closed
    expect(area(other)).to_have_value(SMALL)
    editor._pages.clear()  # its time without a request is over
    for seen in tree.parent.rglob("*.open"):
        os.utime(seen, (0.0, 0.0))
    other.get_by_role("button", name="Restore it").click()
    expect(area(other)).to_have_value(mine)
    assert tree.read_text() == SMALL


def test_a_dry_run_shows_the_states_on_the_drawing(editor: TreeEditor, open_page: Open) -> None:
    page = open_page(editor)
    page.keyboard.press("Control+Enter")
    expect(page.locator('[data-bar="trial"]')).to_contain_text("Dry run: success")
    expect(page.locator(".item.success")).to_have_count(4)


def test_seed_pace_and_values_of_a_run_are_asked_for_and_judged(
    editor: TreeEditor, open_page: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    orders: list[Mapping[str, Any]] = []
    monkeypatch.setattr(editor.trial, "start", lambda order: orders.append(order) or 1)
    page = open_page(editor)
    page.get_by_role("button", name="Run simulated").click()
    dialog = page.get_by_role("dialog", name="Run on the simulated cell")
    dialog.get_by_label("seed").fill("7")
    dialog.get_by_label("pace").select_option("real time")
    dialog.get_by_label("mass").fill("3 mm")
    dialog.get_by_role("button", name="Start").click()
    expect(dialog.get_by_role("alert")).to_contain_text("mass")
    assert orders == []
    dialog.get_by_label("mass").fill("200 g")
    dialog.get_by_role("button", name="Start").click()
    expect(dialog).to_be_hidden()
    assert [(o["seed"], o["real_time"], o["settings"]) for o in orders] == [
        (7, True, {"mass": "200 g"})
    ]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(
    make_editor: Callable[[Path], TreeEditor], tree: Path, open_page: Open, scheme: str
) -> None:
    tree.write_text((Path(__file__).parents[4] / "trees" / "pick_apple.yaml").read_text())
    page = open_page(make_editor(tree), color_scheme=scheme)
    page.evaluate(AXE.read_text(encoding="utf-8"))
    item(page, "root/0").locator(".box").click()
    problems = {"a tree": page.evaluate(FOUND)}
    area(page).fill(
        tree.read_text()
        .replace("SampleGrasp", "SampelGrasp")
        .replace("default: 90 mm", "default: 90 kg")
    )
    expect(page.locator("#findings li").first).to_be_visible()
    problems["findings"] = page.evaluate(FOUND)
    page.keyboard.press("Control+z")
    page.locator("#tree").focus()
    page.keyboard.press("i") if scheme == "light" else page.keyboard.press("m")
    expect(page.locator("#palette")).to_be_visible()
    problems["the palette"] = page.evaluate(FOUND)
    page.keyboard.press("Escape")
    page.locator("#tree").focus()
    page.keyboard.press("Shift+F10")
    problems["the menu"] = page.evaluate(FOUND)
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    problems["the help"] = page.evaluate(FOUND)
    assert {where: found for where, found in problems.items() if found} == {}


def test_a_narrow_page_shows_and_changes_values_only(
    editor: TreeEditor, open_page: Open, tree: Path
) -> None:
    page = open_page(editor, viewport={"width": 390, "height": 844})
    item(page, "root/0").locator(".box").click()
    page.locator("#field-port-wait").fill("4 s")
    page.locator("#field-port-wait").press("Enter")
    page.get_by_role("button", name="Save").click()
    expect(page.locator("#saved")).to_have_text("saved")
    assert tree.read_text() == SMALL.replace("1 s", "4 s")
    expect(page.locator("#insert")).to_be_hidden()
    expect(
        page.get_by_text("inserting and deleting nodes need a window wider than 720 px")
    ).to_be_visible()
    page.locator("#tree").focus()
    page.keyboard.press("Delete")
    expect(page.get_by_role("treeitem")).to_have_count(4)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.evaluate(AXE.read_text(encoding="utf-8"))
    assert page.evaluate(FOUND) == []


def test_a_thousand_nodes_are_drawn_as_those_in_sight(
    make_editor: Callable[[Path], TreeEditor], tree: Path, open_page: Open
) -> None:
    steps = "".join(f"        - wait: {number} s\n" for number in range(99))
    tree.write_text(
        "pomona: 1\ntree: large\nroot:\n  sequence:\n" + ("    - sequence:\n" + steps) * 10
    )
    page = open_page(make_editor(tree))
    page.keyboard.press("End")
    expect(item(page, "root/9/98")).to_be_in_viewport()
    assert page.locator(".item").count() < 80
    page.keyboard.press("d")
    expect(item(page, "root/9/99")).to_be_in_viewport()


def test_the_text_of_a_node_is_never_markup(
    make_editor: Callable[[Path], TreeEditor], tree: Path, open_page: Open
) -> None:
    words = "<img src=x onerror=alert(1)>"
    tree.write_text(
        f"pomona: 1\ntree: a\nroot:\n  wait: 1 s   # {words}\n  name: {json.dumps(words)}\n"
    )
    page = open_page(make_editor(tree))
    expect(page.locator("#tree")).to_contain_text(words)
    assert page.locator("main img").count() == 0


@pytest.mark.parametrize("width", [721, 768, 1100])
def test_the_head_of_a_tablet_fits_its_width_and_covers_nothing(
    editor: TreeEditor, open_page: Open, width: int
) -> None:
    page = open_page(editor, viewport={"width": width, "height": 1024})
    assert page.evaluate("document.documentElement.scrollWidth") == width
    title, save = page.locator(".title").bounding_box(), page.locator("#save").bounding_box()
    assert title["x"] + title["width"] <= save["x"] or title["y"] + title["height"] <= save["y"]
