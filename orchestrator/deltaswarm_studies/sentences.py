"""Make the sentences of findings from results, by the templates of `templates/sentences.toml`.

A sentence is about one metric. Results with the same verdict are told in one go, with the range of their estimates,
where they are all combinations of some levels and cells; the largest such block comes first.
"""

import itertools
import math
import re
import tomllib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

import pandas as pd

from deltaswarm_studies.claims import TWINS
from deltaswarm_studies.rendering import decimals_for, number
from deltaswarm_studies.settings import listed
from deltaswarm_studies.stats import ALPHA, DIFFERENCE, RATIO
from deltaswarm_studies.study import Study

TEMPLATES = tomllib.loads((files("deltaswarm_studies") / "templates" / "sentences.toml").read_text(encoding="utf-8"))

OVER = "on average over {}"

Row = Mapping[Any, Any]


class Result(NamedTuple):
    """A result as a sentence needs it."""

    kind: str
    places: tuple[str, ...]
    """In words: the level, what it is compared with, and the cell."""
    row: Row


Block = Sequence[Result]


def sentences_of(study: Study, chosen: Mapping[str, Any], results: Mapping[str, pd.DataFrame]) -> Iterator[str]:
    """Yield the sentences of what a finding names among the tables of contrasts, claims and fits."""
    kind = next(kind for kind in results if kind in chosen)
    rows = results[kind]
    for name, value in chosen.items():
        rows = rows[rows[name].isin(listed(value))] if len(rows) else rows
    if kind == "fit":
        yield from _closest(study, rows)
        return
    told = list((_of_contrasts if kind == "contrast" else _of_claims)(study, rows.to_dict("records")))
    for same in _grouped(told, lambda own: (own.kind, own.row["metric"], own.row.get("criterion"), len(own.places))):
        by_verdict = _grouped(
            same, lambda own: (own.row["verdict"], own.row["scale"], own.row.get("without"), _is_less(own))
        )
        blocks = sorted(itertools.chain(*map(_blocks, by_verdict)), key=len, reverse=True)
        apart = [
            at for at in range(len(same[0].places)) if len({frozenset(_column(block, at)) for block in blocks}) > 1
        ]
        parts = [_filled("short" if place else "long", study, block, apart) for place, block in enumerate(blocks)]
        text = re.sub(r" +(?=[ ,;)])", "", "; ".join(parts))
        yield " ".join([f"{text[0].upper()}{text[1:]}.", *_of_the_source(same)])


def _grouped(results: Iterable[Result], key: Callable[[Result], Any]) -> list[list[Result]]:
    groups = defaultdict(list)
    for own in results:
        groups[key(own)].append(own)
    return list(groups.values())


def _is_less(own: Result) -> bool:
    """Whether a claim's difference is told as less: by a size, which is positive."""
    is_told = own.kind in ("order", "alike") and own.row["scale"] == DIFFERENCE
    return bool(is_told and (own.row["estimate"] or 0.0) < 0)


def _blocks(results: Block) -> list[Block]:
    """Split results into as few blocks as possible that are all combinations of pairs and cells."""
    keys = [(own.places[:2], *own.places[2:]) for own in results]
    columns = [dict.fromkeys(values) for values in zip(*keys, strict=True)]
    if math.prod(map(len, columns)) == len(results):
        return [results]
    splits = []
    for at in (at for at, values in enumerate(columns) if len(values) > 1):
        parts = [[own for own, key in zip(results, keys, strict=True) if key[at] == value] for value in columns[at]]
        splits.append([*itertools.chain(*map(_blocks, parts))])
    return min(splits, key=len, default=[[own] for own in results])  # two claims may be about the same


def _of_contrasts(study: Study, rows: Sequence[Row]) -> Iterator[Result]:
    asked = {settings.id: settings for settings in study.file.contrast}
    for row in rows:
        places = {(one.level, one.reference, one.within): one for one in study.comparisons(asked[row["contrast"]])}
        one = places[row["level"], row["reference"], row["within"]]
        cell = [study.words(level) for level in one.cell]
        cell += [OVER.format(study.factor_title(over))] if (over := asked[row["contrast"]].over) else []
        if one.between:
            cell.append(" as ".join(map(study.words, one.between)))
        named = (study.words(one.level), study.words(one.reference), *cell)
        yield Result("interaction" if one.between else "contrast", named, row)


def _of_claims(study: Study, rows: Sequence[Row]) -> Iterator[Result]:
    asked = {claim.id: claim for claim in study.file.claim}
    for row in rows:
        claim = asked[row["claim"]]
        rival = row["about"].partition(" over ")[0]
        named = [claim.less, rival] if claim.every else claim.along or claim.variants
        sides = [] if claim.over else [study.levels[name] for name in named]
        common = [name for name in study.factors if sides and all(side[name] == sides[0][name] for side in sides)]
        cell = [study.words(sides[0][name]) for name in common]
        own = [" ".join(study.words(side[name]) for name in study.factors if name not in common) for side in sides]
        if claim.over:
            own, cell = [study.words(claim.less), study.words(rival)], [OVER.format(study.factor_title(claim.over))]
        if claim.best_of:
            own = [*own[:1], f"with {rival}"]
        if claim.kind == "predicts":
            own = [_lower(study.metrics[name].title) for name in claim.predictors]
        a, b = {"trend": (_listed(own, "and"), ""), "value": ("", ""), "published": ("", "")}.get(
            claim.kind, tuple(own if claim.kind == "alike" else reversed(own))
        )
        if row["scale"] == DIFFERENCE and claim.kind in ("order", "alike") and claim.times != 1:
            b = f"{claim.times:g} times that {b}"
        other = study.levels.get(claim.reference, {})
        without = " ".join(study.words(level) for name, level in other.items() if level != sides[0][name])
        yield Result(claim.kind, (a, b, *cell), {**row, "without": without, "question": claim.question})


def _column(block: Block, at: int) -> list[str]:
    """Return the different places of a block's results at one position."""
    return list(dict.fromkeys(own.places[at] for own in block))


def _filled(form: str, study: Study, block: Block, apart: Sequence[int]) -> str:
    """Fill the template of a block's verdict; a short one names only the positions in which the blocks are `apart`."""
    first, kind = block[0].row, block[0].kind
    words = _words(study, block)
    columns = [_column(block, at) for at in range(len(block[0].places))]
    places = [_listed(values, "or" if at < 2 else "and") for at, values in enumerate(columns)]
    level, reference, *cell = places
    pairs = list(dict.fromkeys(own.places[:2] for own in block))
    if len(pairs) < len(columns[0]) * len(columns[1]):
        level, reference = (_listed([pair[at] for pair in pairs], "and") for at in (0, 1))
        reference += ", respectively"
    place = " ".join(f"rather than {places[at]}" if at == 1 else places[at] for at in apart)
    between = " and ".join(columns[-1])
    between = between.replace(" as ", " than ") if first["scale"] == DIFFERENCE else between
    words |= {"level": level, "reference": reference, "between": between}
    words["place"] = f"{place}," if place else ""
    cell = cell[:-1] if kind == "interaction" else cell
    words["where"] = "".join(f", {one}" for one in _cells(study, block, cell))
    words["where"] = words["where"] if level else words["where"].removeprefix(",")
    words["amount"] = TEMPLATES["amount"][first["scale"]].format(**words)
    words["compared"] = TEMPLATES["compared"].get(first["scale"], "").format(**words)
    statements = TEMPLATES["statement"]
    words["statement"] = (statements.get(f"{kind} {first['scale']}") or statements[kind]).format(**words)
    verdict, templates = first["verdict"], TEMPLATES[form]
    keys = [f"{kind} {verdict} {of}" for of in (first.get("criterion"), first["scale"])]
    keys += [f"{verdict} in a question"] * bool(first.get("question")) + [f"{kind} {verdict}", verdict]
    return str(next(templates[key] for key in keys if key in templates).format(**words))


def _cells(study: Study, block: Block, cells: Sequence[str]) -> Iterator[str]:
    """Name a block's cells: all levels of a factor by the factor."""
    for at, text in enumerate(cells, 2):
        values = {own.places[at] for own in block}
        every = [name for name, levels in study.factors.items() if values == {*map(study.words, levels)}]
        is_named = every and (len(values) > 2 or every[0] in study.file.study.words)
        yield study.words(every[0]) if is_named else text


def _words(study: Study, block: Block) -> dict[str, str]:
    """Return what templates may say of a block of results, but for its places."""
    rows, first = [own.row for own in block], block[0].row
    metric = study.metrics[first["metric"]]
    is_plural = bool(re.search(TEMPLATES["plural"], metric.title.lower()))
    size, more, less = TEMPLATES["size"].get("plural" if is_plural else metric.unit) or TEMPLATES["size"]["other"]
    name, unit = _lower(metric.title), "per s" if metric.unit == "1/s" else metric.unit
    values = {key: [float(row[key]) for row in rows if pd.notna(row.get(key))] for key in ("estimate", "low", "high")}
    decimals = decimals_for(itertools.chain(*values.values()))
    decimals = 2 if decimals == 3 else decimals
    estimates, ends = values["estimate"], [*values["low"], *values["high"]]
    own_side = max(estimates, default=0.0) if block[0].kind not in ("value", "published", "trend") else 0.0
    side = -1 if first["scale"] != RATIO and own_side < 0 else 1  # less by a size, which is positive
    interval, of_size = (_interval([sign * end for end in ends], len(rows), decimals) for sign in (1, side))
    n = f"n = {_range([row['n'] for row in rows], 0)}"
    sizes = [abs(one) for one in estimates]
    return {
        "metric": name if is_plural or name.startswith("the ") else f"the {name}",
        "Metric": name if is_plural else f"the {name}",
        "is": "are" if is_plural else "is",
        "it": "they" if is_plural else "it",
        "unit": unit,
        "size": size,
        "more": more,
        "less": less,
        "gap": f"{_range(sizes, decimals)} {'lower' if own_side < 0 else 'higher'}",
        "difference": f"{_range(sizes, decimals)} {unit} {less if own_side < 0 else more}",
        **dict(zip(("rises", "falls"), ("rise", "fall") if is_plural else ("rises", "falls"), strict=True)),
        "estimate": _range(estimates, decimals),
        "interval": f"{of_size}, {n}",
        "interval_of": f"{_range(estimates, decimals)}, {interval}, {n}",
        "scale": first["scale"] or "value",
        "margin": f"{first.get('margin', 0):g}",
        "criterion": str(first.get("criterion")).partition(" (")[0].replace(", within", " to within"),
        "without": first.get("without", ""),
        **{name: number(_known(first.get(name)), decimals) for name in ("ours", "published")},
        "published_n": number(_known(first.get("published_n")), 0),
        "open": "; or ".join(_open(same) for same in _grouped(block, lambda own: own.row["open"])),
        "twin": f"the {_lower(study.metrics[TWINS[first['metric']]].title)}"
        if first["metric"] in TWINS
        else "another outcome",
    }


def _interval(ends: Sequence[float], results: int, decimals: int) -> str:
    if len(ends) < 2 * results:
        return "no interval"
    low, high = (number(choose(ends), decimals) for choose in (min, max))
    return f"{'intervals from' if results > 1 else 'interval'} {low} to {high}"


def _open(block: Block) -> str:
    """Say why results are open, and how many runs they need."""
    row, needed = block[0].row, [own.row.get("needed") for own in block]
    told = [float(f"{one:.2g}") for one in needed if pd.notna(one)]
    runs = f"about {_range(told, 0)}" if len(told) == len(needed) else TEMPLATES["many_runs"]
    kind = "claim " if "claim" in row else "ceiling " if pd.notna(row["p_holm"]) and row["p_holm"] <= ALPHA else ""
    kinds = TEMPLATES["open"]
    return str(kinds.get(f"{kind}{row['open']}") or kinds.get(row["open"], "")).format(needed=runs)


def _of_the_source(results: Block) -> Iterator[str]:
    """Say what the source of a claim says that does not hold, and whether its agreement is evidence."""
    [says, *others] = {own.row.get("says", "") for own in results}
    verdicts = {own.row["verdict"] for own in results}
    if says and not others and not verdicts & {"holds", "agrees"}:
        yield TEMPLATES["says"].format(says=says)
    if verdicts & {"holds", "agrees"} and any(own.row.get("calibrated") for own in results):
        yield TEMPLATES["calibrated"]


def _closest(study: Study, rows: pd.DataFrame) -> Iterator[str]:
    """Say which combination of a fit is closest, and which published numbers decide that."""
    for text, own in rows.groupby("fit", sort=False):
        fit = next(fit for fit in study.file.fit if fit.text == text)
        cells = {
            ", ".join(cell.values()): ", ".join(map(study.words, cell.values())) for cell in study.cells([fit.factor])
        }
        order = own.drop_duplicates("within")
        if len(order) == 1:  # there is nothing to be closer than
            continue
        first, second = (order.iloc[place] for place in (0, 1))
        decisive = []
        for target in fit.targets:
            each = own[(own["level"] == target.level) & (own["metric"] == target.metric)]
            if each.sort_values("without").iloc[0]["within"] != first["within"]:
                decisive.append(f"{_lower(study.metrics[target.metric].title)} {study.words(target.level)}")
        words = {"count": str(len(order)), "within": cells[first["within"]], "next": cells[second["within"]]}
        words |= {"sum": number(first["sum"], 2), "next_sum": number(second["sum"], 2)}
        words |= {"share": number(100 * first["closest"], 0), "decisive": _listed(decisive, "or")}
        yield TEMPLATES["long"]["closest on all" if not decisive else "closest"].format(**words)


def _lower(title: str) -> str:
    return title[:1].lower() + title[1:] if title[1:2].islower() else title


def _known(value: Any) -> float | None:
    return None if pd.isna(value) else float(value)


def _range(values: Sequence[float], decimals: int) -> str:
    """Return a number, or the least and the greatest of several."""
    ends = dict.fromkeys(number(choose(values), decimals) for choose in (min, max)) if values else ["-"]
    return " to ".join(ends)


def _listed(phrases: Iterable[str], last: str) -> str:
    """Join phrases; words with which all begin are said once."""
    told = list(phrases)
    words = [phrase.split() for phrase in told]
    shared = len(list(itertools.takewhile(lambda same: len(set(same)) == 1, zip(*words, strict=False))))
    if len(told) > 1 and shared and words[0][0] != "where":
        is_number = all(own[shared:] and own[shared][0].isdigit() for own in words)
        told[1:] = [" ".join(own[shared if is_number else 1 :]) for own in words[1:]]
    return f" {last} ".join(filter(None, [", ".join(told[:-1]), *told[-1:]]))
