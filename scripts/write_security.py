"""Write what follows from the table of roles: the example files of the router, and the table in the docs.

python scripts/write_security.py           # writes deploy/zenoh and the table in docs/security.md
python scripts/write_security.py --check   # exits 1 where one of them differs from the code
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from caesura_protocol.keys import ROOT
from caesura_service.security import ROLES, Identity
from caesura_service.security.access_rules import granted_rights
from caesura_service.security.zenoh_files import password_router_file, router_file, server_tls_in

TOP = Path(__file__).resolve().parents[1]
PAGE = TOP / "docs" / "security.md"
BEGIN, END = "<!-- roles: written by scripts/write_security.py -->\n", "<!-- end of roles -->"
HOLDERS = (
    Identity("service", "caesura-1"),
    Identity("service", "caesura-2"),
    Identity("bridge", "cell-1"),
    Identity("bridge", "cell-2"),
    Identity("dashboard", "wall"),
    Identity("operator", "boss"),
)
LISTEN = "tls/[::]:7447"
FOLDER = "/etc/zenoh/tls"
NAMES = {
    "put": "puts",
    "subscribe": "subscribes to",
    "query": "asks",
    "answer": "answers",
    "asked": "is asked, as part of",
    "hold": "holds the token",
    "watch": "watches the tokens",
}
REMARK = (
    "Example, with certificates and keys in files. `caesura certs DIR` writes one like it for your own\n"
    "stations, complete with its certificates. Paths are those of the machine that the router runs on."
)


def files() -> dict[Path, str]:
    """Path and content of everything that is written."""
    tls, folder = server_tls_in(FOLDER), TOP / "deploy" / "zenoh"
    names = {holder: holder.label for holder in HOLDERS}
    with_passwords = password_router_file(tls, HOLDERS, LISTEN, f"{FOLDER}/users.txt", REMARK)
    return {
        folder / "router.json5": router_file(tls, names, LISTEN, REMARK),
        folder / "router.password.json5": with_passwords,
        PAGE: _page(),
    }


def _page() -> str:
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    return f"{before}{BEGIN}\n{table()}\n{END}{rest.partition(END)[2]}"


def table() -> str:
    """The roles, as a table for the page."""
    return "\n".join(["| role | may |", "|---|---|", *_rows()]) + "\n"


def _rows() -> Iterator[str]:
    for role, access in ROLES.items():
        rights = [
            f"{NAMES[verb]} {', '.join(f'`{_short(key)}`' for key in keys)}"
            for verb, keys in granted_rights(access("name"))
        ]
        yield f"| `{role}.name` | {'<br>'.join(rights)} |"


def _short(key: str) -> str:
    return key.removeprefix(f"{ROOT}/")


def main() -> int:
    """Write or check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    wanted = files()
    if parser.parse_args().check:
        drifted = [
            str(path.relative_to(TOP))
            for path, text in wanted.items()
            if not path.exists() or path.read_text(encoding="utf-8") != text
        ]
        if drifted:
            print(f"{', '.join(drifted)}: differs from the roles; run scripts/write_security.py")
        return int(bool(drifted))
    for path, text in wanted.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
