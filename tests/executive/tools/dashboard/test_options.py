"""Options of a page's address."""

from __future__ import annotations

import argparse

from pomona.tools.dashboard.options import add_address, make_access


def test_port_0_is_a_free_port_that_the_link_names() -> None:
    parser = argparse.ArgumentParser()
    add_address(parser)
    access = make_access(parser.parse_args(["--port", "0"]))
    assert access.port > 1023
    assert f":{access.port}/" in access.link
