"""Follows every link of a built site that stays inside it: ``python docs/check_links.py docs/_build/html``.

With ``--network`` before the folder it says whether the links that leave the site can be asked from here.
"""

from __future__ import annotations

import sys
import urllib.error
import urllib.request
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# For one site to answer.
SECONDS = 5.0


class Page(HTMLParser):
    """Links and anchors of one page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect what this tag names and points to."""
        for name, value in attrs:
            if value and (name == "id" or (tag == "a" and name == "name")):
                self.anchors.add(value)
            if value and name in ("href", "src"):
                self.links.append(value)


def broken(site: Path) -> list[str]:
    """Links that lead nowhere, and things that a page loads from elsewhere.

    Parameters
    ----------
    site : Path
        Folder of the HTML pages.

    Returns
    -------
    list of str
        One sentence each; empty if all is well.
    """
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        name = path.relative_to(site.resolve())
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            goal = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not goal.exists():
                found.append(f"{name}: {link} does not exist")
            elif parts.fragment and goal in pages and unquote(parts.fragment) not in pages[goal].anchors:
                found.append(f"{name}: {link} has no such anchor")
    return found


def leaving(site: Path) -> list[str]:
    """Links to other sites, each once.

    Parameters
    ----------
    site : Path
        Folder of the HTML pages.

    Returns
    -------
    list of str
        Addresses, in alphabetical order.
    """
    pages = (Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html"))
    return sorted({link for page in pages for link in page.links if urlsplit(link).scheme in ("http", "https")})


def why_unreachable(link: str) -> str:
    """What keeps a site from answering; empty if it answers, whatever it says.

    Parameters
    ----------
    link : str
        Any address of it.

    Returns
    -------
    str
        A few words.
    """
    parts = urlsplit(link)
    request = urllib.request.Request(f"{parts.scheme}://{parts.netloc}/", method="HEAD")
    try:
        urllib.request.urlopen(request, timeout=SECONDS).close()
    except urllib.error.HTTPError as error:
        # A proxy that lets nobody out answers as well.
        return f"{error.code} {error.reason}" if error.code in (403, 407, 502, 503, 504) else ""
    except OSError as error:
        return str(getattr(error, "reason", error))
    return ""


def network(site: Path) -> int:
    """Print whether links to other sites can be asked; 1 if not."""
    links = leaving(site)
    # Two sites, as one may be down.
    hosts = {urlsplit(link).netloc: link for link in links}
    why = [f"{host}: {reason}" for host, link in list(hosts.items())[:2] if (reason := why_unreachable(link))]
    if not links or len(why) == min(2, len(hosts)):
        sys.stdout.write(f"external links not checked: {len(links)} of them ({'; '.join(why) or 'none there'})\n")
        return 1
    sys.stdout.write(f"asking {len(links)} external links\n")
    return 0


def main(arguments: list[str]) -> int:
    """Print what is broken; 1 if anything is."""
    if arguments[0] == "--network":
        return network(Path(arguments[1]))
    site = Path(arguments[0])
    found = broken(site)
    for sentence in found:
        sys.stdout.write(f"{sentence}\n")
    sys.stdout.write(f"{len(found)} broken links in {len(list(site.rglob('*.html')))} pages\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
