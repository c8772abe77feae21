"""Sweep files with anything at all in them: a sweep or a mistake, and never a traceback."""

import json
import tomllib
from typing import Any

import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.sweeps.load import make_sweep
from deltaswarm_wire import checked
from deltaswarm_wire.checked import SettingsError

KEYS = st.one_of(
    st.sampled_from(
        ["control.delta", "control", "delta", "radio.loss", "radio", "label", "seed", "events.density", "file", "name"]
    ),
    st.sampled_from(["", ".", "a.", "control.delta.x", "events.density.components", "arena.width_m", "__class__"]),
    st.text(max_size=5),
)
VALUES: st.SearchStrategy[Any] = st.recursive(
    st.one_of(
        st.none().map(lambda _: tomllib.loads("d = 1979-05-27T07:32:00Z")["d"]),
        st.booleans(),
        st.integers(),
        st.integers(min_value=2**64, max_value=2**80),
        st.floats(),
        st.text(max_size=5),
        st.sampled_from([2, 3, 0.5, "hybrid", "uniform", 10**400]),
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(KEYS, inner, max_size=3)),
    max_leaves=8,
)
RIGHT = st.fixed_dictionaries(
    {"axes": st.just({"radio": {"loss": [0.0, 0.5]}})},
    optional={
        "paired": st.just([{"agents": {"count": [3, 4]}, "radio.range_m": [9, 2**70]}]),
        "variants": st.lists(st.fixed_dictionaries({"control.delta": st.integers(1, 99)}), unique_by=str, min_size=1),
        "repeats": st.integers(1, 9),
    },
)
LIKELY = st.fixed_dictionaries(
    {},
    optional={
        "axes": st.dictionaries(KEYS, st.one_of(st.lists(st.integers(1, 9), max_size=3), VALUES), max_size=3),
        "paired": st.lists(st.dictionaries(KEYS, st.lists(VALUES, min_size=2, max_size=2), max_size=3), max_size=2),
        "variants": st.lists(st.dictionaries(KEYS, VALUES, max_size=3), max_size=3),
        "repeats": st.one_of(st.integers(1, 3), VALUES),
        "seed": st.one_of(st.integers(0, 9), VALUES),
    },
)
TABLES = st.fixed_dictionaries(
    {"base": st.just("smoke")},
    optional={"sweep": st.one_of(RIGHT, LIKELY, VALUES), "scenario": VALUES, "name": VALUES, "schema": VALUES},
)


@given(
    st.one_of(
        TABLES,
        st.fixed_dictionaries({"base": st.just("smoke"), "sweep": RIGHT}),
        st.dictionaries(KEYS, VALUES, max_size=4),
    )
)
def test_whatever_a_file_holds_it_is_a_sweep_or_a_mistake(table: dict[str, Any]) -> None:
    """A mistake can be said; a sweep's own record makes the same sweep again."""
    said: list[str] = []
    try:
        sweep = make_sweep(table)
    except SettingsError as error:
        said = [str(problem) for problem in error.problems]
        assert all(said)
        assert said
        return
    assert sweep.jobs()
    assert len({variant.label for variant in sweep.variants}) == len(sweep.variants)
    kept = checked.plain(sweep.file)
    assert json.dumps(kept)
    again = make_sweep(tomllib.loads(tomli_w.dumps(kept)))
    assert [job.key for job in again.jobs()] == [job.key for job in sweep.jobs()]
