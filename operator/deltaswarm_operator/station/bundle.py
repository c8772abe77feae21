"""Join the page's files: one script and one style sheet, so that a page over a slow link needs three requests. Pure."""

import re
from collections.abc import Mapping

SCRIPT, STYLE = "page.js", "page.css"
FIRST = "main.js"
LIBRARY = "vendor/uPlot.iife.min.js"
STYLES = ("vendor/uPlot.min.css", "style.css", "panels.css", "lists.css", "dialogs.css", "tasks.css", "screens.css")

_IMPORT = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"\./(\w+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:const|let|class|function) (\w+))", re.MULTILINE)


def bundle(files: Mapping[str, str]) -> dict[str, str]:
    """Return the script and the style sheet that stand for all others, by name.

    A module becomes a function that is called once and returns its exports, in the order in which they are needed.
    """
    modules: dict[str, str] = {}

    def add(name: str) -> None:
        if name in modules:
            return
        modules[name] = ""  # for one that needs itself by another
        source = files[name]
        for _, other in _IMPORT.findall(source):
            add(f"{other}.js")
        exports = ", ".join(export for _, export in _EXPORT.findall(source))
        body = _EXPORT.sub(r"\1", _IMPORT.sub(_taken, source))
        del modules[name]
        modules[name] = f"const {_variable(name)} = (() => {{\n{body}\nreturn {{ {exports} }};\n}})();\n"

    add(FIRST)
    return {SCRIPT: files[LIBRARY] + "\n" + "".join(modules.values()), STYLE: "\n".join(files[one] for one in STYLES)}


def _taken(found: re.Match[str]) -> str:
    names = found[1].replace(" as ", ": ")
    return f"const {{{names}}} = {_variable(found[2])};\n"


def _variable(name: str) -> str:
    return f"module_{name.removesuffix('.js')}"
