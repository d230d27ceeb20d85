"""Options of everything that serves the operator's page."""

from __future__ import annotations

import argparse
import socket
from pathlib import Path
from typing import TYPE_CHECKING

from pomona.executive.errors import UsageError

if TYPE_CHECKING:
    from pomona.tools.dashboard.security import Access

PORT = 8420  # default port of the page


def add_address(parser: argparse.ArgumentParser, port: int = PORT) -> None:
    """Add the options of the page's address, with this default of the port."""
    parser.add_argument(
        "--port", type=int, default=port, help=f"port of the page (default: {port}; 0: a free one)"
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default: this machine only)"
    )
    parser.add_argument(
        "--served-as",
        action="append",
        default=[],
        metavar="NAME",
        help="a name by which browsers reach this machine",
    )
    parser.add_argument(
        "--tls-cert",
        type=Path,
        metavar="FILE",
        help="certificate (PEM): the page is served with TLS",
    )
    parser.add_argument("--tls-key", type=Path, metavar="FILE", help="the certificate's key (PEM)")
    parser.add_argument(
        "--insecure-act",
        action="store_true",
        help="with another --host: allow actions without encryption",
    )


def free_port() -> int:
    """Return a port of this machine that is free now."""
    with socket.socket() as line:
        line.bind(("127.0.0.1", 0))
        return int(line.getsockname()[1])


def make_access(options: argparse.Namespace) -> Access:
    """Return the rules for an address: another one than this machine's may only watch, unless TLS or the flag allows.

    Raises UsageError: the certificate comes without its key, or the other way round.
    """
    from pomona.tools.dashboard.security import Access

    if (options.tls_cert is None) != (options.tls_key is None):
        raise UsageError("--tls-cert and --tls-key belong together")
    local = options.host in ("127.0.0.1", "localhost", "::1")
    return Access(
        options.host,
        options.port or free_port(),
        may_act=local or options.tls_cert is not None or options.insecure_act,
        certificate=options.tls_cert,
        key=options.tls_key,
        names=tuple(options.served_as),
    )
