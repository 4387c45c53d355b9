"""Prints the licences of all packages that taichisoft and its extras bring, as their metadata say.

docs/licences.md gets those that need attention.

Versions are left out, so that the page is wrong only when a package comes, goes, or changes its licence. It is about
the packages that pip installs on Linux with Python 3.11 or 3.12; run it in the environment of `make test`.
"""

import re
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PAGE = Path(__file__).with_name("licences.md")
BEGIN, END = "<!-- written by write_licences.py -->\n", "<!-- to here -->\n"
EXTRAS = ("web", "gym", "sofa", "studies", "arm", "notebook", "xlsx")
NOT_NAMED = "not named"
COPYLEFT = re.compile("GPL|General Public|MPL|Mozilla")
LINUX = {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "x86_64", "python_version": "3.12"}


def brought(name: str, extras: frozenset[str], seen: dict[tuple[str, str], None]) -> Iterator[str]:
    """Names of the packages that a package with extras needs, itself left out."""
    for line in distribution(name).requires or ():
        requirement = Requirement(line)
        for extra in ("", *extras):
            environment = LINUX | {"extra": extra, "python_full_version": "3.12.0", "implementation_name": "cpython"}
            key = (canonicalize_name(requirement.name), ",".join(sorted(requirement.extras)))
            if key in seen or (requirement.marker and not requirement.marker.evaluate(environment)):
                continue
            seen[key] = None
            if is_installed(requirement.name):
                yield key[0]
                yield from brought(requirement.name, frozenset(requirement.extras), seen)


def is_installed(name: str) -> bool:
    try:
        distribution(name)
    except PackageNotFoundError:  # of another system or Python
        return False
    return True


def licence(one: Distribution) -> str:
    """The licence as the metadata name it: an expression, classifiers, or a short text."""
    metadata = one.metadata
    classifiers = [
        line.rpartition(" :: ")[2] for line in metadata.get_all("Classifier") or () if line.startswith("License :: ")
    ]
    named = [name for name in classifiers if name != "OSI Approved"]
    text = " ".join((metadata.get("License") or "").split())
    short = text if 0 < len(text) <= 60 and text.upper() != "UNKNOWN" else ""
    return metadata.get("License-Expression") or short or ", ".join(sorted(named)) or NOT_NAMED


def all_brought() -> dict[str, str]:
    """The mark of each package: "" of the core, else " [extra]"."""
    seen: dict[tuple[str, str], None] = {}
    part = dict.fromkeys(brought("taichisoft", frozenset(), seen), "")
    for extra in EXTRAS:
        part |= {name: f" [{extra}]" for name in brought("taichisoft", frozenset([extra]), seen) if name not in part}
    return part


def by_licence() -> dict[str, list[str]]:
    """The packages of each licence, those of the extras marked; copyleft ones first."""
    packages: dict[str, list[str]] = {}
    for name, mark in sorted(all_brought().items()):
        packages.setdefault(licence(distribution(name)), []).append(f"{name}{mark}")
    return dict(sorted(packages.items(), key=lambda item: (not COPYLEFT.search(item[0]), item[0].lower())))


def table() -> str:
    """A row for each copyleft licence, and one of the packages that name none."""
    rows = [
        f"| {text.replace('|', '/')} | {', '.join(names)} |"
        for text, names in by_licence().items()
        if COPYLEFT.search(text) or text == NOT_NAMED
    ]
    return "\n".join(["| licence | packages |", "|---|---|", *rows]) + "\n"


def page() -> str:
    """The page with a new table."""
    before, after = PAGE.read_text(encoding="utf-8").split(BEGIN)
    return f"{before}{BEGIN}{table()}{END}{after.partition(END)[2]}"


if __name__ == "__main__":
    for text, names in by_licence().items():
        print(f"{text}: {', '.join(names)}")
    PAGE.write_text(page(), encoding="utf-8")
