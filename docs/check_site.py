"""Check built pages as they lie in a folder: python docs/check_site.py FOLDER.

* nothing is loaded from a network,
* every link to a page of the site meets a page, and every anchor an element,
* links to the outside are those of ``outside.toml``, each with what is there and when it was seen,
* the first use of a word of the glossary links there, on each page,
* the search finds pages without a server: Node.js runs the site's own scripts, if it is there.

It prints a line for each fault, and ends with 1 if there is one.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from glossary_words import entries, linked

LOADING = {"script": "src", "img": "src", "link": "href", "source": "src", "iframe": "src",
           "object": "data", "embed": "src", "video": "src", "audio": "src"}  # fmt: skip
"""What a browser fetches by itself, and the attribute that says from where."""

LINKS_ALONE = {"search", "index", "next", "prev", "canonical", "author", "license", "help"}
"""Kinds of ``link`` that are fetched only when somebody follows them."""

SOUGHT = {"mass": "own_vehicle", "funnel": "certify", "lag": "certify", "super-twisting": "theory",
          "sweep": "sweeps", "glossary": "glossary", "dead time": "certify"}  # fmt: skip
"""Words that a reader may look for, and a page that has to be among what is found."""

SEARCH = """
const fs = require("fs"), vm = require("vm");
const folder = process.argv[2];
const element = () => ({ classList: { add() {}, remove() {} }, dataset: {}, style: {},
  appendChild() {}, setAttribute() {}, addEventListener() {}, querySelector: () => null,
  querySelectorAll: () => [] });
const document = Object.assign(element(), { readyState: "loading", title: "", cookie: "",
  createElement: element, getElementById: () => null, body: element(),
  documentElement: Object.assign(element(), { dataset: { content_root: "./" } }) });
const context = vm.createContext({ document, console, URLSearchParams, URL,
  location: { search: "", href: "file:///search.html" }, addEventListener() {},
  localStorage: { getItem: () => null, setItem() {} }, setTimeout, navigator: {},
  DOCUMENTATION_OPTIONS: { LINK_SUFFIX: ".html", BUILDER: "html", FILE_SUFFIX: ".html" } });
context.window = context;
const run = (name) => vm.runInContext(fs.readFileSync(`${folder}/${name}`, "utf8"), context, name);
for (const name of ["documentation_options", "doctools", "sphinx_highlight", "language_data",
                    "searchtools"]) {
  if (fs.existsSync(`${folder}/_static/${name}.js`)) run(`_static/${name}.js`);
}
vm.runInContext("this.Search = Search", context);
run("searchindex.js");
const words = JSON.parse(process.argv[3]), found = {};
for (const word of words) {
  vm.runInContext(`answer = Search._performSearch(...Search._parseQuery(${JSON.stringify(word)}))`,
                  context);
  found[word] = context.answer.map((r) => r[0]);
}
console.log(JSON.stringify(found));
"""


APART = {"glossary", "api", "commands", "index", "claims", "errata", "genindex", "search"}
"""Lists, where words are not linked; pages of models are equations."""

CLOSED = {"h1", "h2", "h3", "h4", "h5", "h6", "a", "code", "pre", "math", "table", "figcaption",
          "script", "style", "svg", "details"}  # fmt: skip
"""Elements whose text is no prose."""


class Page(HTMLParser):
    """Links, anchors, loaded files and prose of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.loaded: list[str] = []
        self.prose: list[tuple[str, str]] = []  # pieces of text, and links to words, as they stand
        self._article = False
        self._closed: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what an element has."""
        said = {k: v or "" for k, v in attrs}
        self.anchors |= {said[k] for k in ("id", "name") if k in said}
        if tag == "a" and "href" in said:
            self.links.append(said["href"])
        kinds = set(said.get("rel", "").split())
        if tag in LOADING and LOADING[tag] in said and not kinds & LINKS_ALONE:
            self.loaded.append(said[LOADING[tag]])
        self._article = self._article or tag == "article"
        if self._article and "term" in said.get("class", "").split():
            self.prose.append(("word", said.get("href", "").partition("#")[2]))
        if tag in CLOSED:
            self._closed.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Leave an element."""
        self._article = self._article and tag != "article"
        if self._closed and self._closed[-1] == tag:
            self._closed.pop()

    def handle_data(self, data: str) -> None:
        """Note prose."""
        if self._article and not self._closed:
            self.prose.append(("text", data))


def unlinked(page: Page) -> list[str]:
    """Words of the glossary whose first use in the prose of a page does not link there."""
    left, found = dict(entries()), []
    for kind, text in page.prose:
        anchors = {text} if kind == "word" else set()
        if kind == "text" and (hit := linked(text, left)):
            found.append(text[hit[0] : hit[1]])
            anchors = {hit[2]}
        left = {word: anchor for word, anchor in left.items() if anchor not in anchors}
    return found


def outside(link: str) -> bool:
    """Whether a link leaves the folder."""
    return bool(urlsplit(link).scheme or urlsplit(link).netloc)


def faults(folder: Path) -> list[str]:
    """What is wrong with the links and loaded files of a site."""
    pages = {p: Page(p.read_text(encoding="utf-8")) for p in sorted(folder.rglob("*.html"))}
    known = tomllib.loads((Path(__file__).parent / "outside.toml").read_text(encoding="utf-8"))
    found = []
    for path, page in pages.items():
        where = path.relative_to(folder)
        if where.stem not in APART and where.parts[0] not in {"models", "_modules"}:
            found += [f"{where}: {word!r} does not link to the glossary" for word in unlinked(page)]
        for link in page.loaded:
            if outside(link) and not link.startswith("data:"):
                found.append(f"{where}: loads {link}")
            elif not outside(link) and not (path.parent / unquote(urlsplit(link).path)).is_file():
                found.append(f"{where}: loads {link}, which is not there")
        for link in page.links:
            if outside(link):
                if not link.startswith("mailto:") and link.partition("#")[0] not in known:
                    found.append(f"{where}: {link} is not in outside.toml")
                continue
            file, anchor = unquote(urlsplit(link).path), unquote(urlsplit(link).fragment)
            target = (path.parent / file).resolve() if file else path
            if not target.exists():
                found.append(f"{where}: {link} meets nothing")
            elif anchor and target in pages and anchor not in pages[target].anchors:
                found.append(f"{where}: {link} meets a page without #{anchor}")
    for sheet in folder.rglob("*.css"):
        text = sheet.read_text(encoding="utf-8", errors="replace")
        if "url(http" in text.replace('"', "").replace("'", "") or "@import url(//" in text:
            found.append(f"{sheet.relative_to(folder)}: loads from a network")
    return found


def sought(folder: Path, node: str) -> list[str]:
    """What the search does not find."""
    script = folder.resolve().parent / f"{folder.name}_search.cjs"
    script.write_text(SEARCH, encoding="utf-8")
    try:
        ran = subprocess.run([node, str(script), str(folder.resolve()), json.dumps(list(SOUGHT))],
                             capture_output=True, text=True, check=False)  # fmt: skip
    finally:
        script.unlink()
    if ran.returncode:
        return [f"the search breaks: {ran.stderr.strip()[-400:]}"]
    answers = json.loads(ran.stdout)
    return [f"the search for {word!r} does not find {page}: {answers[word][:5]}"
            for word, page in SOUGHT.items() if page not in answers[word]]  # fmt: skip


def main() -> int:
    """Check the folder that is named."""
    folder = Path(sys.argv[1])
    if not (folder / "index.html").is_file():
        print(f"{folder} has no index.html; sphinx-build docs {folder} makes it")
        return 2
    found = faults(folder)
    if node := shutil.which("node"):
        found += sought(folder, node)
    else:
        print("no Node.js: the search is not tried")
    for line in found:
        print(line)
    print(f"{len(list(folder.rglob('*.html')))} pages, {len(found)} faults")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
