"""Write what follows from the table of the page's messages: the page's types, and the tables of docs/STATION.md.

`python docs/extensions/page_messages.py docs/STATION.md` writes both.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from deltaswarm_scenario.page_messages import EVERYBODY, FROM_PAGE, INPUT, LEFT_OUT, TO_PAGE, Field, MessageForm

ROOT = Path(__file__).parents[2]
TYPES = ROOT / "operator/deltaswarm_operator/station/page/messages.d.ts"
BEGIN, END = "<!-- messages -->\n", "<!-- /messages -->\n"

HEAD = """\
/** Messages between feed and page. Written by docs/extensions/page_messages.py; do not change it by hand. */

import type {
  Act,
  AgentRow,
  CommandRow,
  EventRow,
  Form,
  HistoryRow,
  InboxRow,
  Language,
  Point,
  Probe,
  Session,
  Target,
  Truth,
  Workload,
} from "./types.js";
"""


def types() -> str:
    """Return the page's type declarations of all messages."""
    named = {"hello": "Hello", "picture": "Picture", "catch_up": "CatchUp"}
    lines = [HEAD]
    for kind, name in named.items():
        lines += [
            f"/** {TO_PAGE[kind].meaning} */",
            f"export type {name} = {_type(kind, TO_PAGE[kind], line=chr(10))};",
            "",
        ]
    others = (_type(kind, form) for kind, form in TO_PAGE.items() if kind not in named)
    lines += ["export type Message =", *(f"  | {one}" for one in (*named.values(), *others))]
    lines[-1] += ";"
    lines += [
        "",
        "export type Intent =",
        *(f"  | {_type(kind, form, is_sent=True)}" for kind, form in FROM_PAGE.items()),
    ]
    lines[-1] += ";"
    lines += [
        "",
        "/** What every input of a person has besides. */",
        f"export type Input = {_fields(INPUT, is_sent=True)};",
    ]
    return "\n".join(lines) + "\n"


def _type(kind: str, form: MessageForm, *, is_sent: bool = False, line: str = " ") -> str:
    return _fields(form.fields, f'type: "{kind}"', is_sent=is_sent, line=line)


def _fields(named: Mapping[str, Field], *first: str, is_sent: bool = False, line: str = " ") -> str:
    fields = [*first]
    for name, field in named.items():
        mark = "?" if field.default is LEFT_OUT else ""
        null = " | null" if mark and is_sent else ""
        fields.append(f"{name}{mark}: {field.type.replace('integer', 'number')}{null}")
    between = line if line == " " else f"{line}  "
    return f"{{{between}{f';{between}'.join(fields)}{line}}}"


def with_tables(page: str) -> str:
    """Return docs/STATION.md with the present tables between its marks."""
    before, rest = page.split(BEGIN)
    lines = ["From the feed to the page:", "", *_table(TO_PAGE, "to", _names)]
    lines += ["", "From the page to the feed:", "", *_table(FROM_PAGE, "from", _bounds)]
    return before + BEGIN + "\n" + "\n".join(lines) + "\n\n" + END + rest.split(END)[1]


def _table(forms: Mapping[str, MessageForm], header: str, fields: Callable[[MessageForm], str]) -> Iterator[str]:
    yield from (f"| type | {header} | contents | fields |", "| --- | --- | --- | --- |")
    for kind, form in forms.items():
        pages = "every page" if form.pages == EVERYBODY else ", ".join(form.pages)
        yield f"| `{kind}` | {pages} | {form.meaning} | {fields(form)} |"


def _names(form: MessageForm) -> str:
    return ", ".join(f"`{name}`" for name in form.fields)


def _bounds(form: MessageForm) -> str:
    return "; ".join(f"`{name}`: {_described(field)}" for name, field in form.fields.items())


def _described(field: Field) -> str:
    return field.described + ("" if field.is_required else ", optional")


if __name__ == "__main__":
    TYPES.write_text(types())
    page = Path(sys.argv[1])
    page.write_text(with_tables(page.read_text()))
