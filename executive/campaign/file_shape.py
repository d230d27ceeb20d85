"""Shapes that campaign files have beside those of tree files; what is wrong becomes a finding."""

from __future__ import annotations

from executive.values.shape import Shape, shape_of
from executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar


class CampaignShape(Shape):
    """Asks nodes for words, lists of words and seeds."""

    def word(self, node: YamlNode | None, default: str) -> str:
        """A scalar's text, or the default when it is left out."""
        scalar = self.text(node)
        return default if scalar is None else scalar.text

    def needed_word(self, owner: YamlMapping, key: str) -> str:
        """A scalar that must be there."""
        if key not in owner.entries:
            self.findings.error(owner, "missing-key", f"'{key}' is missing", f"write '{key}: …'")
        return self.word(owner.get(key), "")

    def words(self, node: YamlNode, what: str, allow_empty: bool = False) -> tuple[str, ...]:
        """A list of scalars, each once."""
        if not isinstance(node, YamlList):
            self.findings.error(node, "shape", f"{what} is a list of values, this is {shape_of(node)}", "write [a, b]")
            return ()
        if not node.items and not allow_empty:
            self.findings.error(node, "empty", f"{what} is an empty list")
        found: list[str] = []
        for item in self.scalars(node):
            if item.text in found:
                self.findings.error(item, "duplicate", f"'{item.text}' is given twice")
            found.append(item.text)
        return tuple(found)

    def scalars(self, node: YamlNode) -> list[YamlScalar]:
        """The items of a list that are single values; the others become findings."""
        items = node.items if isinstance(node, YamlList) else []
        texts = [self.text(item) for item in items]
        return [text for text in texts if text is not None]

    def lists(self, node: YamlNode | None, what: str, how: str) -> dict[str, tuple[str, ...]]:
        """A mapping of lists of scalars."""
        return {key.text: self.words(value, f"'{key.text}'") for key, value in self.entries(node, what, how)}

    def seeds(self, node: YamlNode | None, default: int | tuple[int, ...], most: int) -> int | tuple[int, ...]:
        """A count from 1 to `most`, or a list of seeds."""
        if node is None:
            return default
        if isinstance(node, YamlList):
            texts = self.words(node, "'seeds'")
            wrong = [item for item in self.scalars(node) if not item.text.isascii() or not item.text.isdigit()]
            for item in wrong:
                self.findings.error(item, "seed", f"a seed is a whole number of at least 0, not '{item.text}'")
            return default if wrong else tuple(map(int, texts))
        text = node.text if isinstance(node, YamlScalar) else ""
        if text.isascii() and text.isdigit() and 1 <= int(text) <= most:
            return int(text)
        message = f"'seeds' is a count from 1 to {most}, or a list of seeds"
        self.findings.error(node, "seeds", message, "write 'seeds: 3' or 'seeds: [3, 7, 11]'")
        return default
