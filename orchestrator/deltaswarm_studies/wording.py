"""Check that sentences which say that something makes no difference rest on an equivalence with a margin."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from deltaswarm_studies.settings import FindingSettings, listed
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import Problem

_WORSE = "shorter|sooner|later|earlier|more|less|fewer|faster|slower|better|worse|higher|lower|larger|smaller"
_WORSE += "|longer(?= than|[.,;:]|$)"  # "no longer" is also said of times
_SIZES = "many|much|long|late|soon|early|often|fast|busy|well|good|bad|quick|quickly|few|little|high|low"
_SIZES += "|large|small|strong|short|cheap|safe|robust|reliable|effective|efficient|accurate|rare|rarely"
NO_DIFFERENCE = re.compile(
    r"\bno (\w+ )?(differences?|changes?|effects?|influence|impact|bearing|harm|"
    r"gains?|advantages?|benefits?|costs?|penalty)\b"
    r"|\bno\b[^,;]{1,40} (shows?|has|have|makes?|brings?) an? (\w+ )?(difference|change|effect|gain|advantage)\b"
    r"|\b(not|\w+n't|never) (differ|change|matter|affect|help|harm|suffer|lengthen|shorten|notice|depend|tell)\b"
    r"|\b(hardly|barely|scarcely|next to nothing|in no mode|neither)\b|\b(\w+s|seen|make) nothing\b"
    rf"|\b(not|no|nor|\w+n't) (\w+ )?({_WORSE})\b(?! than (\d|half|twice|a (third|quarter|fifth)))"
    rf"|\bas ({_SIZES})\b"
    r"|\bas (before|without|in|with|ever|usual)\b|\bjust as \w+"
    r"|\b(irrelevant|immaterial|insensitive|invariant|interchangeable|constant|negligible|independent(ly)? of)\b"
    r"|\b(stay|stays|remain|remains) (flat|steady|put|intact)\b"
    r"|\bsame\b(?! (cases?|runs?|replicates?|arrivals|seeds?|swarms?|events?))|(?<!at )\bequal(s|ly)?\b"
    r"|\b(alike|identical(ly)?|unchanged|unaffected|indistinguishable|equivalent|comparable|similar(ly)?|on (a )?par)\b"
    r"|\btell\b.*\bapart\b|\bkeeps pace\b|\bmatch(es)?\b",
    re.IGNORECASE,
)
"""Ways to say that two things do not differ."""
RATIO = re.compile(
    rf"\b(times|half|twice|third|thirds|quarters|fifths)\s+as ({_SIZES})\b(( \w+){{0,3}} as\b( \w+)?)?", re.I
)
"""Phrases that only look like one of them: "1.6 times as long", "half as many as without"."""
OPEN = re.compile(
    r"\b((is|are|be|was|still|stays?|remains?|left|leaves?( \w+)?|as|question)\s+open|"
    r"undecided|unclear|unknown|not (known|decided|settled|shown either way)|cannot be (told|said))\b",
    re.I,
)
"""Ways to say that a question is not answered."""
NEEDS_MARGIN = (
    "says that there is no difference, so it must rest on an equivalence with a margin: a contrast that is 'alike', a "
    "claim of kind 'alike' that holds, or a published number that agrees; or say that the question is open"
)

UNDECIDED = ("unclear", "undecided")
WITHIN = ("alike", "slightly higher", "slightly lower")
"""Verdicts of a contrast whose interval lies within its margin."""


def says_no_difference(text: str) -> list[str]:
    """List the sentences of a text that say that something does not differ, and do not leave it open."""
    return [one for one in re.split(r"(?<=[.;:!?])\s+", " ".join(text.split())) if _is_said(one)]


def _is_said(sentence: str) -> bool:
    return bool(NO_DIFFERENCE.search(RATIO.sub("", sentence))) and not OPEN.search(sentence)


def unsaid(study: Study) -> Iterator[Problem]:
    """Report findings and claims whose words say more than their verdicts can show."""
    claims = {claim.id: claim for claim in study.file.claim}
    for where, text in _untested(study):
        if said := [one for one in says_no_difference(text) if not re.search(r"^the same\b|\?$", one, re.I)]:
            allowed = "says that there is no difference: say it in a finding, which rests on a result with a margin"
            yield Problem(where, repr(said[0]), allowed)
    for i, claim in enumerate(study.file.claim):
        if claim.kind in ("order", "predicts") and (said := says_no_difference(claim.text)):
            yield Problem(f"claim[{i}].text", repr(said[0]), "says that there is no difference: needs kind 'alike'")
    for i, finding in enumerate(study.file.finding):
        where = f"finding[{i}].text"
        if (said := says_no_difference(finding.text)) and not margins_of(study, finding):
            yield Problem(where, repr(said[0]), NEEDS_MARGIN)
        undecided = [result for result in finding.because if set(UNDECIDED) & set(listed(result["is"]))]
        if undecided and not OPEN.search(finding.text):
            allowed = f"must say that something is open, since {_name(undecided[0])} is {undecided[0]['is']!r}"
            yield Problem(where, repr(" ".join(finding.text.split())), allowed)
        for j, result in enumerate(finding.because):
            yield from _impossible(study, result, f"finding[{i}].because[{j}].is")
            for id in listed(result.get("claim", [])):
                if claims[id].calibrated and {"holds", "agrees"} & set(listed(result["is"])):
                    allowed = f"is no evidence: {', '.join(claims[id].calibrated)} was chosen so that it agrees"
                    yield Problem(f"finding[{i}].because[{j}].claim", repr(id), allowed)


def _untested(study: Study) -> Iterator[tuple[str, str]]:
    """Yield the place and the words of every text of a page that no result must support."""
    file = study.file
    yield "study.title", file.study.title
    for name in ("contrast", "fit", "grid", "survival", "rings"):
        yield from ((f"{name}[{i}].text", one.text) for i, one in enumerate(getattr(file, name)))
    yield from ((f"figure[{i}].caption", figure.caption) for i, figure in enumerate(file.figure))


def _impossible(study: Study, result: Mapping[str, Any], where: str) -> Iterator[Problem]:
    """Report verdicts that a contrast without a margin, or a claim of another kind, cannot have."""
    named = listed(result["is"])
    for contrast in study.file.contrast:
        if contrast.id in listed(result.get("contrast", [])) and not contrast.margin and set(named) <= set(WITHIN):
            yield Problem(where, repr(result["is"]), f"needs a margin in the contrast {contrast.id!r}")
    for claim in study.file.claim:
        if claim.id in listed(result.get("claim", [])) and not set(named) & {*claim.verdicts, "no data"}:
            allowed = f"must be one of {', '.join(claim.verdicts)}: the claim {claim.id!r} can have no other verdict"
            yield Problem(where, repr(result["is"]), allowed)


def _name(result: Mapping[str, Any]) -> str:
    kind = next(kind for kind in ("claim", "contrast") if kind in result)
    return f"the {kind} {result[kind]!r}"


def margins_of(study: Study, finding: FindingSettings) -> list[str]:
    """List the margins of the equivalences that support a finding."""
    margins = []
    for result in finding.because:
        verdicts, units = set(listed(result["is"])), study.metrics
        if verdicts <= set(WITHIN):
            ids = listed(result.get("contrast", []))
            margins += [f"{contrast.margin:g} times" for contrast in study.file.contrast if contrast.id in ids]
        for claim in study.file.claim:
            if claim.id in listed(result.get("claim", [])):
                if claim.kind == "alike" and claim.ratio == 1 and verdicts == {"holds"}:
                    margins.append(f"{claim.margin:g} times")
                elif claim.kind == "published" and verdicts == {"agrees"}:
                    low, high = claim.region
                    margins.append(f"{low:g} to {high:g} {units[claim.metric].unit}".rstrip())
    return list(dict.fromkeys(margins))
