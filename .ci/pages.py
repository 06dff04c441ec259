"""Check the pages of the API: each public name once, no internal module, no broken link. Usage: pages.py FOLDER."""

import importlib
import re
import sys
from pathlib import Path

MODULES = "jhd", "jhd.arithmetic", "jhd.io", "jhd.plot", "jhd.progress", "jhd.published", "jhd.typing"
folder = Path(sys.argv[1])
pages = {file: file.read_text(encoding="utf-8") for file in folder.rglob("*.html")}
wanted = {folder / "index.html", *(folder / f"{name.replace('.', '/')}.html" for name in MODULES)}
wrong = [f"{file} documents an internal module" for file in pages.keys() - wanted]
wrong += [f"{file} is missing" for file in wanted - pages.keys()]
for name in MODULES:
    page = pages.get(folder / f"{name.replace('.', '/')}.html", "")
    for public in importlib.import_module(name).__all__:
        # A public module has a page of its own.
        count = page.count(f'id="{public}"')
        if count != 1 and f"{name}.{public}" not in MODULES:
            wrong.append(f"{name}.{public} is documented {count} times")
for file, page in pages.items():
    for link in set(re.findall(r'href="([^"]+)"', page)):
        where, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:|\$", link):  # elsewhere, or a template of the search
            continue
        target = (file.parent / where).resolve() if where else file.resolve()
        # Members of enumerations have no entry of their own.
        anchor = re.sub(r"^(RESULTS|EVENTS|ANSWERS|DIRECTIONS)\..*", r"\1", anchor)
        found = {f.resolve(): text for f, text in pages.items()}.get(target)
        if found is None or (anchor and f'id="{anchor}"' not in found):
            wrong.append(f"{file}: broken link {link}")
print("\n".join(wrong) or f"{len(pages)} pages")
sys.exit(bool(wrong))
