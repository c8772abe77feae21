"""Schemas and layout: what viewers can read and show."""

import json
from typing import Any

import jsonschema
import pytest

from deltaswarm_orchestrator.recording.foxglove import (
    FIGURE_TOPICS,
    NET_FIELDS,
    SCHEMAS,
    STATE_FIELDS,
    VIEW_TOPICS,
    layout,
)
from deltaswarm_wire.truth import Tally


def flaws(schema: Any, place: str = "schema") -> list[str]:
    """What of a schema Lichtblick's parser refuses, by the rules of that parser."""
    if not isinstance(schema, dict) or schema.get("type") != "object" or "properties" not in schema:
        return [f"{place}: no object"]
    found = []
    for name, field in schema["properties"].items():
        where, kind = f"{place}.{name}", field.get("type")
        if "oneOf" in field:
            if not all(type(choice.get("const")) is int and "title" in choice for choice in field["oneOf"]):
                found.append(f"{where}: oneOf of something else than titled numbers")
        elif kind == "object":
            found += flaws(field, where)
        elif kind == "array":
            items = field["items"]
            if items.get("type") == "object":
                found += flaws(items, where)
            elif items.get("type") not in ("boolean", "string", "number", "integer"):
                found.append(f"{where}: items of type {items.get('type')}")
        elif kind not in ("boolean", "string", "number", "integer"):
            found.append(f"{where}: type {kind}")
    return found


@pytest.mark.parametrize("name", SCHEMAS)
def test_schemas_are_flat(name: str) -> None:
    """A viewer's parser takes each schema: no $ref, no anyOf, no nullable types, no arrays of arrays."""
    text = json.dumps(SCHEMAS[name])
    assert flaws(SCHEMAS[name]) == []
    assert not any(word in text for word in ("$ref", "anyOf", "allOf", "null"))
    jsonschema.Draft7Validator.check_schema(SCHEMAS[name])


@pytest.mark.parametrize(
    "field",
    [
        {"$ref": "#/definitions/x"},
        {"anyOf": [{"type": "number"}, {"type": "null"}]},
        {"type": ["number", "null"]},
        {"type": "array", "items": {"type": "array", "items": {"type": "number"}}},
        {"oneOf": [{"type": "number"}, {"type": "string"}]},
    ],
)
def test_the_rule_for_flat_schemas_bites(field: Any) -> None:
    """The test above would notice each of the forms that break viewers."""
    assert flaws({"type": "object", "properties": {"field": field}})


def test_two_topics_hold_every_field_of_a_tally() -> None:
    """A field that is added to the tally is recorded without a word here."""
    assert sorted([*NET_FIELDS, *STATE_FIELDS, "step", "time_s"]) == sorted(Tally._fields)
    for name, fields in (("deltaswarm.NetStats", NET_FIELDS), ("deltaswarm.SwarmState", STATE_FIELDS)):
        assert {"step", "time_s", *fields} <= set(SCHEMAS[name]["properties"])


@pytest.mark.parametrize("size", [(100.0, 100.0), (1000.0, 20.0), (5.0, 30.0)])
def test_the_layout_shows_the_whole_arena(size: tuple[float, float]) -> None:
    """Every scene topic is on, the camera above the centre sees the longest side, and all panels are placed."""
    shown = layout(*size)
    scene = shown["configById"]["3D!arena"]
    assert {topic for topic in scene["topics"] if scene["topics"][topic]["visible"]} == VIEW_TOPICS.keys() - {"/tf"}
    camera = scene["cameraState"]
    seen_m = 2 * camera["distance"] * 0.41421  # twice the tangent of half of 45 degrees
    assert max(size) < seen_m < 1.5 * max(size)
    assert camera["far"] > camera["distance"]
    text = json.dumps(shown["layout"])
    assert all(panel in text for panel in shown["configById"])


def test_the_layout_plots_what_is_recorded() -> None:
    """Each plotted path is a field of the schema of its topic."""
    for panel, settings in layout(100.0, 100.0)["configById"].items():
        for path in settings["paths"] if panel.startswith("Plot!") else ():
            topic, name = path["value"].split(".")
            assert name in SCHEMAS[FIGURE_TOPICS[topic]]["properties"]
