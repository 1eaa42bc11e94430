"""Checks a site that mdBook has built: every relative link and anchor leads somewhere, every page of docs/ is in it.

    python3 packaging/site/check.py target/book
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote


class Page(HTMLParser):
    """Anchors of a page, and targets of its links and pictures."""

    def __init__(self, text):
        super().__init__()
        self.anchors, self.targets = set(), []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.anchors.update(attributes[key] for key in ("id", "name") if attributes.get(key))
        self.targets.extend(attributes[key] for key in ("href", "src") if attributes.get(key))


def main():
    site = Path(sys.argv[1]).resolve()
    # The printable page repeats all others with their links.
    pages = {file: Page(file.read_text()) for file in site.rglob("*.html") if file.name not in ("print.html", "404.html")}
    broken = []
    for file, page in pages.items():
        for target in page.targets:
            path, _, anchor = unquote(target).partition("#")
            if ":" in path or path.startswith("//"):
                continue
            there = (file.parent / path).resolve() if path else file
            if there.is_dir():
                there /= "index.html"
            if not there.exists() or (anchor and there in pages and anchor not in pages[there].anchors):
                broken.append(f"{file.relative_to(site)}: {target}")
    docs = Path(__file__).resolve().parents[2] / "docs"
    for page in docs.rglob("*.md"):
        name = "index.html" if page.name == "README.md" else page.stem + ".html"
        if page.name != "SUMMARY.md" and site / page.relative_to(docs).with_name(name) not in pages:
            broken.append(f"docs/{page.relative_to(docs)} is not in docs/SUMMARY.md")
    print("\n".join(broken) if broken else f"{len(pages)} pages, all links lead somewhere")
    sys.exit(bool(broken))


if __name__ == "__main__":
    main()
