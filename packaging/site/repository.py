"""Preprocessor of mdBook for docs/, whose pages also link to files of the repository outside docs/.

On a site these lead nowhere. Links become addresses in the repository (the branch `main`, or the tag in
MICROSIG_REF), and pictures become part of the page, so that the site needs no other host to be read.
"""

import base64
import json
import os
import re
import sys
from pathlib import Path

LINK = re.compile(r"(!?)(\[[^\]]*\])\(([^)\s]+)\)")
CODE = re.compile(r"(^[ ]*```.*?^[ ]*```)", re.MULTILINE | re.DOTALL)
KINDS = {".png": "image/png", ".svg": "image/svg+xml", ".jpg": "image/jpeg"}


def address(root, reference):
    """Address of a file or folder of the repository; the URL is that of Cargo.toml."""
    manifest = (root / "Cargo.toml").read_text()
    url = re.search(r'^repository = "([^"]+)"', manifest, re.MULTILINE).group(1)
    kind = "tree" if reference.is_dir() else "blob"
    return f"{url}/{kind}/{os.environ.get('MICROSIG_REF', 'main')}/{reference.relative_to(root).as_posix()}"


def converted(text, page, source, root):
    """The text of a page with its links out of docs/ replaced; code blocks stay as they are."""

    def replace(match):
        picture, label, target = match.groups()
        path, _, anchor = target.partition("#")
        if not path or ":" in path:
            return match.group()
        file = Path(os.path.normpath(page.parent / path))
        if file.is_relative_to(source):
            # mdBook names the pages of these files index.html, but not in links.
            return match.group().replace("README.md", "index.html")
        if not file.exists():
            sys.exit(f"{page}: {target} does not exist")
        if picture:
            data = base64.b64encode(file.read_bytes()).decode()
            return f"!{label}(data:{KINDS[file.suffix]};base64,{data})"
        return f"{label}({address(root, file)}{'#' + anchor if anchor else ''})"

    parts = CODE.split(text)
    parts[::2] = [LINK.sub(replace, part) for part in parts[::2]]
    return "".join(parts)


def chapters(items):
    """All chapters of a book, with their subchapters."""
    for item in items:
        if isinstance(item, dict) and "Chapter" in item:
            yield item["Chapter"]
            yield from chapters(item["Chapter"]["sub_items"])


def main():
    if sys.argv[1:2] == ["supports"]:
        sys.exit(0 if sys.argv[2] == "html" else 1)
    context, book = json.load(sys.stdin)
    root = Path(context["root"]).resolve()
    source = root / context["config"]["book"]["src"]
    # mdBook 0.4 names the list `sections`.
    for chapter in chapters(book["items"] if "items" in book else book["sections"]):
        if chapter.get("source_path"):
            page = source / chapter["source_path"]
            chapter["content"] = converted(chapter["content"], page, source, root)
    json.dump(book, sys.stdout)


if __name__ == "__main__":
    main()
