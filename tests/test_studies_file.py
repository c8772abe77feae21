"""Study files: those that come with deltaswarm are sound, and mistakes are told by name before anything runs."""

from pathlib import Path

import pytest

from deltaswarm_orchestrator.cli import main
from deltaswarm_orchestrator.studies.study import COLLECTIONS, default_factors, load_study
from deltaswarm_orchestrator.sweeps.load import BUILT_IN, load_sweep
from deltaswarm_wire.checked import SettingsError
from tests.studying import OWN, SWEEP, made

STUDIES = [name for names in COLLECTIONS.values() for name in names]


@pytest.mark.parametrize("name", STUDIES)
def test_a_built_in_study_can_show_what_it_asks(name: str) -> None:
    """Twenty replicates of each variant, and enough of them for its contrasts; every figure has a caption."""
    study = load_study(name)
    assert study.repeats == 20
    assert study.file.figure
    assert all(figure.caption and figure.name for figure in study.file.figure)
    assert all(contrast.text and contrast.id for contrast in study.file.contrast)
    assert len({claim.id for claim in study.file.claim}) == len(study.file.claim)


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_built_in_sweep_can_be_studied(name: str) -> None:
    """A study file is a sweep file, and a bare sweep a study that asks nothing."""
    assert load_study(name).sweep.variants
    assert len(set(default_factors(load_sweep(name)))) == len(load_sweep(name).factors)


def test_the_plan_says_what_so_many_replicates_could_show(capsys: pytest.CaptureFixture[str]) -> None:
    """Before hours are spent: six replicates can show nothing under Holm over nine comparisons."""
    assert main(["study", "jamming", "--repeats", "6", "--plan"]) == 0
    few = capsys.readouterr().out
    assert "9 replicates are needed" in few
    assert few.count("6 tests") == 4
    assert main(["study", "jamming", "--plan"]) == 0
    assert "needed" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("own", "path"),
    [
        ('[[contrast]]\nid = "a"\nfactor = "los"\nreference = "loss=0.0"\n', "contrast[0].factor"),
        ('[[contrast]]\nid = "a"\nfactor = "loss"\nreference = "0.0"\n', "contrast[0].reference"),
        ('[[contrast]]\nid = "a"\nfactor = "loss"\nreference = "loss=0.0"\nmetrics = ["w"]\n', "contrast[0].metrics"),
        ('[[claim]]\nid = "a"\ntext = "t"\nless = "x"\nmore = "loss=0.0, hybrid 3"\n', "claim[0] (a)"),
        ('[[claim]]\nid = "a"\ntext = "t"\nkind = "value"\nof = "loss=0.0, hybrid 3"\n', "claim[0].within"),
        ('[[claim]]\nid = "a"\ntext = "t"\nkind = "alike"\na = "b"\nb = "c"\nmargin = 0.9\n', "claim[0].margin"),
        ('[[recovery]]\nfactor = "loss"\nlevel = "loss=0.5"\nreference = "no loss"\n', "recovery[0].level"),
        ('[[figure]]\nname = "f"\nkind = "boxes"\nx = "modes"\n', "figure[0]"),
        ('[[figure]]\nname = "f"\nkind = "pie"\n', "figure[0].kind"),
        ('[[figure]]\nname = "f"\nkind = "plane"\nx = "mode"\n', "figure[0].x"),
        ('[[finding]]\ntext = "t"\nbecause = [{ claim = "none", is = "holds" }]\n', "finding[0].because"),
        ('[[metric]]\nname = "m"\nkind = "window"\nof = "waiting"\n', "metric[0].of"),
        ('[[metric]]\nname = "m"\n', "metric[0].column"),
        ("[study]\nfactors = { loss = \"one\" }\n", "study.factors"),
        ("[study]\ntitel = \"t\"\n", "study.titel"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_by_name(own: str, path: str) -> None:
    """Where it stands, before anything runs."""
    with pytest.raises(SettingsError) as caught:
        made(own if own.startswith("[study]") else OWN + own)
    assert path in [problem.path for problem in caught.value.problems]


def test_a_study_file_is_a_sweep_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`deltaswarm sweep` leaves out what is asked of it."""
    (tmp_path / "own.toml").write_text(SWEEP + OWN)
    assert main(["sweep", str(tmp_path / "own.toml"), "--dry-run"]) == 0
    assert "6 variants x 10 replicates" in capsys.readouterr().out
