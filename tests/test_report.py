"""Figures and reports from a small synthetic comparison: what a reader must find on them, and what must never happen."""

from __future__ import annotations

import base64
import dataclasses
import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pneuid.criticism.comparison.comparison import Comparison, EquationDefect, SignalError
from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.comparison.regions import Region
from pneuid.criticism.decision.diagnosis import Candidate, Diagnosis, Unknown
from pneuid.criticism.prediction.horizons import Prediction
from pneuid.estimation.preparation import data_ranges, prepare
from pneuid.model import DataFile, FitSummary, Model, nominal_model
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.report import quantities, sections, style
from pneuid.report.decision_figures import group_letters, ladder, ladder_words, overall, ranking, rung_errors
from pneuid.report.friction_figure import friction_curve, steady_resistance
from pneuid.report.html import Items, Paragraph, Picture, Section, Table, page, write_report
from pneuid.report.reports import compare_report, diagnose_report, identify_report
from pneuid.report.signal_figures import errors_bar, overlay, residual_map, role_word, telling_run, worst_span
from pneuid.report.signal_units import ErrorUnit, error_unit, shown
from pneuid.report.trust_sections import trust_section
from pneuid.rig import Rig

SERVO = {
    "kind": "servo", "friction": "lugre", "conventions": {"pressure": "gauge"},
    "cylinder": {
        "bore": "32 mm", "rod": "12 mm", "stroke": "500 mm", "dead_volume_1": "12 cm^3", "dead_volume_2": "14 cm^3",
    },
    "load": {"mass": "2.4 kg"},
    "valve": {"conductance": "1.2e-8 m^3/(s*Pa)", "critical_ratio": 0.3, "full_scale": "10 V", "null": "0 V"},
    "supply": {"pressure": "600 kPa"}, "sensors": {"x": "20 um", "p1": "0.5 kPa", "p2": "0.5 kPa"},
}  # fmt: skip
BENCH = {
    "kind": "bench", "friction": "lugre", "conventions": {"pressure": "gauge"},
    "cylinder": {"bore": "32 mm", "rod": "12 mm"}, "load": {"mass": "2.4 kg"},
    "sensors": {"x": "1 um", "p1": "0.5 kPa", "p2": "0.5 kPa", "F": "0.2 N"},
}  # fmt: skip
PATM = 101_325.0
NASTY = '<script>alert("$x_1$")</script>.csv'
FRICTION = {"Fc": 12.0, "Fs": 20.0, "vs": 0.008, "sigma0": 4e5, "sigma1": 300.0, "sigma2": 45.0}


def recording(rig: Rig, name: str, k: int, n: int = 2000) -> Recording:
    t = np.arange(n) * 1e-3
    rng = np.random.default_rng(k)
    x = 0.25 + 0.12 * np.sin(2.4 * t + k) + 0.04 * np.sin(9.0 * t)
    p1 = PATM + 2e5 + 1e5 * k + 4e4 * np.sin(3 * t)
    p2 = PATM + 2.2e5 + 1e5 * k + 5e4 * np.sin(4 * t + 1)
    if rig.kind == "servo":
        x = x + 2e-5 * rng.standard_normal(n)
        return Recording.from_arrays(name, rig, t=t, u=3 * np.sin(2 * t), x=x, p1=p1, p2=p2)
    v = 0.12 * 2.4 * np.cos(2.4 * t + k) + 0.36 * np.cos(9.0 * t)
    F = 10 * np.sign(v) + 20 * v + 0.2 * rng.standard_normal(n)
    return Recording.from_arrays(name, rig, t=t, x=x, p1=PATM + 1e5 * k + 0 * t, F=F)


def predictions(run, size: dict[str, float], windows: bool, seed: int) -> tuple[Prediction, Prediction]:
    rng = np.random.default_rng(seed)
    scale = np.array([size[name] for name in run.outputs])[:, None]
    measured = np.vstack([run.measured(name) for name in run.outputs])
    used = np.ones_like(measured, dtype=bool)
    error = scale * (0.3 * rng.standard_normal(measured.shape) + np.sin(7 * run.t))
    free = Prediction(run, np.arange(run.n), measured - 3 * error, measured, used)
    if not windows:
        return free, free
    at = np.arange(100, run.n - 100)
    return Prediction(run, at, (measured - error)[:, at], measured[:, at], used[:, at]), free


def comparison_of(kind: str, names: tuple[str, ...] = ("monday_1.csv", NASTY, "tuesday.csv")) -> Comparison:
    rig = Rig.from_dict(SERVO if kind == "servo" else BENCH)
    runs = [recording(rig, name, k) for k, name in enumerate(names)]
    model = nominal_model(rig, FRICTION, data_ranges(runs, Plant(rig, "lugre")))
    noise = {"x": 2e-5, "p1": 500.0, "p2": 500.0} if kind == "servo" else {"x": 1e-6, "F": 0.2}
    verdicts = ("well determined", "weakly determined", "on its bound", "not visible")
    estimates = tuple(
        dataclasses.replace(item, std=0.004 * item.value, verdict=verdicts[k % 4])
        for k, item in enumerate(model.parameters)
    )
    data = tuple(DataFile(run.name, run.sha256, run.n, "train" if k < 2 else "hold_out") for k, run in enumerate(runs))
    model = dataclasses.replace(
        model, name="Monday & <b>co</b>", parameters=estimates, noise=noise, data=data,
        fit=FitSummary("exact", True, "exact: continuity holds everywhere", 1.02, "ipopt", 9, 0.8),
    )  # fmt: skip
    size = {"x": 3e-4, "p1": 4e3, "p2": 2e3, "F": 1.0}
    pairs = [predictions(prepare(run, model.plant, noise), size, kind == "servo", k) for k, run in enumerate(runs)]
    units = {"x": "m", "p1": "Pa", "p2": "Pa", "F": "N"}
    floor = {"x": 2e-5, "p1": 500.0, "p2": 510.0, "F": 0.2}
    errors = {
        name: SignalError(units[name], size[name], 3 * size[name], 97.3, floor[name], 0.02 * floor[name])
        for name in model.plant.outputs
    }
    return Comparison(
        model=model, train=errors,
        hold_out={name: dataclasses.replace(item, rmse=1.4 * item.rmse) for name, item in errors.items()},
        where=(Region(model.plant.outputs[-1], 0.61, 0.08, "v < 0 and p1 > 400 kPa gauge"),),
        defects=(EquationDefect("force", "N", 4.1, 0.6), EquationDefect("pressure_1", "kPa", 0.8, 0.7)),
        predictions=tuple(pair[0] for pair in pairs), free=tuple(pair[1] for pair in pairs),
        roles=("train", "train", "hold_out"),
    )  # fmt: skip


@pytest.fixture(scope="module", params=["servo", "bench"])
def comparison(request) -> Comparison:
    return comparison_of(request.param)


@pytest.fixture(scope="module")
def servo() -> Comparison:
    return comparison_of("servo")


DIAGNOSIS = Diagnosis(
    "effect", ("leakage_internal",),
    (
        Candidate("leakage_internal", "flow_1", 0.42, 0.085, 0.97, 1e-30),
        Candidate("leakage_external_1", "flow_1", 0.31, 0.62, 0.4, 1e-7, ("leakage_external_2",)),
        Candidate("leakage_external_2", "flow_2", 0.30, 2.7, -0.4, 0.2, ("leakage_external_1",)),
        Candidate("user <i>effect</i> with a name that is much too long for an axis", "force", 0.0),
    ),
    Unknown("force", ("x", "v"), 4.1, "N"),
    {"why": "a dwell under load tells them apart", "file": "next.csv", "power": 0.93},
    ("held-out error: 113 times the noise floor before, 1.0 after",),
)  # fmt: skip

FLOOR = {"x": 2e-5, "p1": 500.0, "p2": 500.0}


def rung(added: str | None, accepted: bool, size: float, count: int) -> Rung:
    errors = {name: size * value for name, value in FLOOR.items()}
    return Rung((added,) if added else (), added, accepted, errors, errors, FLOOR, count)


RUNGS = (
    rung(None, True, 113.0, 8), rung("gravity", False, 110.0, 9), rung("friction_position", False, float("inf"), 17),
    rung("leakage_internal", True, 1.04, 9),
)  # fmt: skip


# --- figures ---


def figures(comparison: Comparison) -> dict[str, Figure]:
    return {
        "overlay": overlay(comparison),
        "enlarged": overlay(comparison, 1, (0.5, 1.5), (0.7, 0.9)),
        "residual map": residual_map(comparison),
        "friction": friction_curve(comparison),
        "errors": errors_bar(comparison),
        "ranking": ranking(DIAGNOSIS),
        "ladder": ladder(RUNGS),
    }


NO_UNIT = {"error / noise floor (both rms)", "held-out error with it / without it"}


def check_figure(name: str, figure: Figure) -> None:
    canvas = FigureCanvasAgg(figure)
    with style.drawing():
        canvas.draw()
    assert figure.legends, f"{name}: no legend"
    frame = figure.bbox
    for axes in figure.axes:
        labels = [axes.get_ylabel(), axes.get_xlabel()]
        for label in filter(None, labels):
            assert re.search(r"\(.+\)", label) or label in NO_UNIT, f"{name}: '{label}' has no unit"
        for axis in (axes.xaxis, axes.yaxis):
            assert axis.get_offset_text().get_text() == "", f"{name}: ticks with an offset"
            boxes = [
                tick.get_window_extent() for tick in axis.get_ticklabels() if tick.get_text() and tick.get_visible()
            ]
            boxes.sort(key=lambda box: (box.x0, box.y0))
            overlapping = [box for box, other in pairwise(boxes) if box.overlaps(other)]
            assert not overlapping, f"{name}: tick labels overlap"
        for text in axes.texts:
            assert text.get_window_extent().x1 <= frame.x1 + 1, f"{name}: '{text.get_text()}' leaves the page"
    bottom = figure.axes[-1]
    assert bottom.get_xlabel() or name == "friction", name


def test_every_figure_is_complete_and_readable(comparison):
    before = dict(mpl.rcParams)
    for name, figure in figures(comparison).items():
        assert isinstance(figure, Figure)
        check_figure(name, figure)
    assert dict(mpl.rcParams) == before


def test_nothing_uses_the_global_state_of_pyplot():
    folder = Path(style.__file__).parent
    assert all(
        "pyplot" not in path.read_text("utf-8").replace("pyplot is not used", "") for path in folder.glob("*.py")
    )


def test_a_figure_is_the_same_bytes_each_time(servo):
    assert style.svg(errors_bar(servo)) == style.svg(errors_bar(servo))
    assert style.png(errors_bar(servo)).startswith(b"\x89PNG")


def test_pressures_are_shown_gauge(servo):
    labels = [axes.get_ylabel() for axes in overlay(servo).axes]
    assert "p₁ (kPa gauge)" in labels and "x (mm)" in labels
    assert shown("p1", PATM + 3e5, PATM) == pytest.approx(300.0)
    assert shown("x", 0.25, PATM) == pytest.approx(250.0)
    assert error_unit("x", 2e-5) == ErrorUnit("µm", 1e6)
    assert error_unit("p1", 4e3).unit == "kPa" and error_unit("F", 1.0).unit == "N"


def test_the_most_telling_run_is_a_held_out_one_and_its_worst_second_is_shown(servo):
    assert telling_run(servo) == 2
    item = servo.predictions[0]
    spike = item.predicted.copy()
    spike[0, 900:1100] += 1.0
    first = dataclasses.replace(item, predicted=spike)
    worse = dataclasses.replace(servo, predictions=(first, *servo.predictions[1:]))
    low, high = worst_span(worse, 0)
    assert low <= item.run.t[item.index[900]] and item.run.t[item.index[1099]] <= high + 1e-3
    assert high - low == pytest.approx(1.0)
    only_train = dataclasses.replace(worse, roles=("train",) * 3, hold_out={})
    assert telling_run(only_train) == 0


def test_thinned_keeps_extremes_and_gaps():
    t = np.arange(100_000) * 1e-3
    y = np.sin(t)
    y[40_123], y[70_000:70_010] = 9.0, np.nan
    kept, values = style.thinned(t, y)
    assert kept.size < 5000 and np.all(np.diff(kept) > 0)
    assert np.nanmax(values) == 9.0 and np.isnan(values).any()
    assert style.thinned(t[:10], y[:10])[1].size == 10


def test_diverged_and_empty_results_can_be_drawn(servo):
    diverged = {
        name: dataclasses.replace(item, rmse=np.inf, free_run_rmse=np.inf) for name, item in servo.hold_out.items()
    }
    items = []
    for item in servo.predictions:
        broken = item.predicted.copy()
        broken[:, 500:] = np.nan
        items.append(dataclasses.replace(item, predicted=broken))
    nothing = np.zeros((3, 0))
    empty = Prediction(items[0].run, np.zeros(0, dtype=int), nothing, nothing, nothing.astype(bool))
    for found in (tuple(items), (items[0], items[1], empty)):
        changed = dataclasses.replace(servo, hold_out=diverged, predictions=found, where=(), defects=())
        for draw in (overlay, residual_map, friction_curve, errors_bar):
            check_figure(draw.__name__.replace("friction_curve", "friction"), draw(changed))


# --- friction ---


@pytest.mark.parametrize("kind", ["servo", "bench"])
def test_steady_resistance_is_the_friction_law(kind):
    model = comparison_of(kind).model
    v = np.array([-0.3, -0.004, 0.002, 0.05])
    expected = np.sign(v) * (12.0 + 8.0 * np.exp(-((v / 0.008) ** 2))) + 45.0 * v
    assert steady_resistance(model, v, 0.2, PATM + 3e5, PATM + 4e5) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("kind", "effects"), [("servo", ("load_mass", "gravity")), ("bench", ("gravity",))])
def test_steady_resistance_holds_constant_forces_and_ignores_mass(kind, effects):
    base = comparison_of(kind).model
    changed = nominal_model(base.rig, {**FRICTION, "mass": 5.0, "F_g": 7.0}, base.ranges, effects)
    v = np.array([-0.1, 0.1])
    at = (v, 0.2, PATM + 3e5, PATM + 4e5)
    assert steady_resistance(changed, *at) == pytest.approx(steady_resistance(base, *at) + 7.0)


def test_friction_curve_has_one_line_where_pressure_does_not_matter_and_a_mark_per_pressure(servo):
    labels = [text.get_text() for text in friction_curve(servo).legends[0].get_texts()]
    assert sum(label.startswith("model") for label in labels) == 1
    assert sum(label.startswith("data") for label in labels) == 3
    dependent = nominal_model(servo.model.rig, {**FRICTION, "k1": 3e-5}, servo.model.ranges, ("friction_pressure",))
    figure = friction_curve(dataclasses.replace(servo, model=dependent))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sum(label.startswith("model") for label in labels) == 3


# --- ranking and ladder ---


def test_groups_get_a_letter():
    assert group_letters(DIAGNOSIS.ranking) == ["", "A", "A", ""]


def test_rungs_are_measured_by_one_floor():
    high = dataclasses.replace(RUNGS[0], noise_floor={name: 50 * value for name, value in FLOOR.items()})
    totals = [overall(item) for item in rung_errors((high, *RUNGS[1:]))]
    assert totals == pytest.approx([113.0, 110.0, np.inf, 1.04])


def test_the_ladder_in_words():
    assert ladder_words(RUNGS) == (
        "Held-out error: from 113 times the noise floor to 1.04 times the noise floor with 1 more parameter (8 to 9). "
        "2 further steps were tried and rejected."
    )
    assert ladder_words(RUNGS[:1]) == "Held-out error: 113 times the noise floor with 8 parameters."


# --- numbers ---


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [
        (14.2134, 0.0612, ("14.213", "0.061")),
        (448_213.0, 1234.0, ("448 213", "1 234")),
        (1.2e-9, None, ("1.200·10⁻⁹", "—")),
        (-0.5843, 0.02, ("−0.584", "0.020")),
        (0.0, 0.3, ("0.00", "0.30")),
        (3.0, float("nan"), ("3.000", "—")),
    ],
)
def test_a_value_has_the_digits_of_its_error(value, std, words):
    assert quantities.with_error(value, std) == words


def test_numbers_read_plainly():
    assert [quantities.number(v) for v in (0.0, 0.012345, 123456.0, -3.0)] == ["0", "0.0123", "123 000", "−3.00"]
    assert [quantities.times(v) for v in (1.04, 187.0, np.inf)] == ["1.0×", "190×", "diverged"]
    assert [quantities.percent(v) for v in (0.61, 0.001, 0.0)] == ["61 %", "< 1 %", "0 %"]
    assert [quantities.percent(v) for v in (0.998, 1.0, -0.2)] == ["> 99 %", "100 %", "−20 %"]
    assert [quantities.change(*v) for v in ((2.0, 1.0), (2.0, 1.999), (0.0, 1.0))] == ["-50 %", "+0 %", "—"]
    assert [quantities.probability(v) for v in (0.2, 3e-6, 1e-30)] == ["= 0.2", "< 10⁻⁵", "< 10⁻⁹"]
    assert quantities.handy("m^3/(s*Pa)") == ("dm³/(s·bar)", 1e8)
    assert quantities.handy("kg/m^3*K") == ("kg/m³·K", 1.0)
    assert quantities.fixed(-0.2, 0) == "0"


# --- the page ---


class Outline(HTMLParser):
    """Checks nesting; collects headings, addresses and image texts."""

    VOID = {"meta", "img", "br"}

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.addresses: list[str] = []
        self.headings: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.addresses += [value for key, value in attrs if key in {"src", "href"}]
        if tag == "img":
            assert dict(attrs)["alt"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def outline(path: Path) -> Outline:
    found = Outline()
    found.feed(path.read_text("utf-8"))
    assert found.open == []
    return found


REPORTS = {
    "identify": (
        lambda path, c: identify_report(path, c, RUNGS, DIAGNOSIS),
        ["Summary", "Ladder", "Verdict", "Ranking", "Parameters", "How far to trust the numbers", "Errors", "Where it fails",
         "Measured and predicted", "Friction", "Data and notes"],
    ),
    "compare": (
        compare_report,
        ["Summary", "Errors", "Where it fails", "Measured and predicted", "Friction", "Parameters", "Data and notes"],
    ),
    "diagnose": (
        lambda path, c: diagnose_report(path, c, DIAGNOSIS, RUNGS),
        ["Verdict", "Ladder", "Ranking", "Summary", "Errors", "Where it fails", "Measured and predicted", "Friction",
         "Parameters", "Data and notes"],
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def written(servo, tmp_path_factory) -> dict[str, Path]:
    """Every report, each alone in its folder."""
    paths = {name: tmp_path_factory.mktemp(name) / "report.html" for name in REPORTS}
    for name, (write, _) in REPORTS.items():
        write(paths[name], servo)
    return paths


@pytest.mark.parametrize("name", REPORTS)
def test_a_report_has_all_its_sections(written, name):
    assert outline(written[name]).headings == REPORTS[name][1]


@pytest.mark.parametrize("name", REPORTS)
def test_a_report_is_one_self_contained_page(written, name):
    found = outline(written[name])
    assert {address.split(",")[0].split("#")[0] for address in found.addresses} == {"data:image/svg+xml;base64", ""}
    assert not re.search(r"https?://|@import|url\(", written[name].read_text("utf-8"))
    assert {item.name for item in written[name].parent.iterdir()} == {"report.html", "figures"}


@pytest.mark.parametrize("name", REPORTS)
def test_names_from_files_are_escaped_everywhere(written, name):
    text = written[name].read_text("utf-8")
    assert outline(written[name]).tags.isdisjoint({"script", "b", "i"})
    assert "&lt;script&gt;alert(" in text and "Monday &amp; &lt;b&gt;co&lt;/b&gt;" in text
    for encoded in re.findall(r"base64,([A-Za-z0-9+/=]+)", text):
        assert b"<script" not in base64.b64decode(encoded)


def test_what_a_report_says(servo, written):
    text = written["identify"].read_text("utf-8")
    for words in (
        "61 % of the squared p2 error sits in 8 % of the samples: v &lt; 0 and p1 &gt; 400 kPa gauge.",
        "x 200 ms ahead: 420 µm rms, fit 97.3 %, 21× the noise floor",
        "Missing from the model: leakage_internal.",
        "Chance that it decides: 93 %.",
        "from 113 times the noise floor to 1.04",
        servo.model.data[0].sha256[:12],
    ):
        assert words in text, words
    assert servo.model.data[0].sha256 not in text
    assert "Relaxed" not in text


def test_a_relaxed_fit_is_labelled(servo):
    estimates = tuple(dataclasses.replace(item, std=None) for item in servo.model.parameters)
    fit = dataclasses.replace(
        servo.model.fit, stage="relaxed", status="relaxed: the model leaves jumps; no standard errors"
    )
    model: Model = dataclasses.replace(servo.model, fit=fit, parameters=estimates)
    relaxed = dataclasses.replace(servo, model=model)
    text = page("relaxed", [sections.summary(relaxed), sections.parameters(model)])
    assert (
        text.count("Relaxed fit, the values are provisional and have no standard errors: the model leaves jumps.") == 2
    )
    assert '<td class="r">—</td>' in text
    assert "1-sigma" not in text
    trusted = trust_section(relaxed)
    assert not any(isinstance(part, Table) for part in trusted.parts)


def test_runs_that_the_model_was_not_fitted_on_are_called_compared(servo):
    held = [item for item in servo.model.data if item.role == "hold_out"]
    data = (*held, DataFile("other.csv", "0" * 64, 9, "train"))
    other = dataclasses.replace(
        servo, model=dataclasses.replace(servo.model, data=data), hold_out={}, roles=("train",) * 3
    )
    assert role_word(other, "train") == "compared" and role_word(servo, "train") == "training"
    assert overlay(other, 0).axes[0].get_title("left").endswith("compared run")
    assert any("Compared runs:" in str(part) for part in sections.summary(other).parts)


def test_reports_of_poor_results_are_written_too(servo, tmp_path):
    bare = dataclasses.replace(
        servo, hold_out={}, where=(), defects=(), roles=("train",) * 3,
        train={name: dataclasses.replace(item, rmse=np.inf, free_run_rmse=np.inf) for name, item in servo.train.items()},
    )  # fmt: skip
    compare_report(tmp_path / "a.html", bare)
    text = (tmp_path / "a.html").read_text("utf-8")
    assert "the prediction diverges" in text and "none was held out" in text
    nothing = dataclasses.replace(servo, train={}, hold_out={}, predictions=(), free=(), roles=(), where=(), defects=())
    diagnose_report(tmp_path / "b.html", nothing, Diagnosis("adequate", (), ()), ())
    assert "No runs to compare with." in (tmp_path / "b.html").read_text("utf-8")


def test_a_report_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "report.html"
    path.write_text("old", encoding="utf-8")
    with pytest.raises(ValueError, match="zip"):
        write_report(path, "t", [Section("s", (Table(("a", "b"), (("1",),), "lr"),))])
    assert path.read_text("utf-8") == "old"
    write_report(path, "t\udcff", [Section("s", (Paragraph("p", "note"), Items(("one",))))])
    assert {item.name for item in tmp_path.iterdir()} == {"report.html", "figures"}
    assert "<title>t?</title>" in path.read_text("utf-8")


def test_a_page_without_figures_is_small():
    text = page("A & B", [Section("One", (Table(("a",), (("x",), ("<y>",)), "l", "c", frozenset({1})),))])
    assert "<h1>A &amp; B</h1>" in text and '<tr class=faint><td class="l">&lt;y&gt;</td></tr>' in text
    assert len(text) < 6000
    assert "data:image" not in text
    assert "data:image" in page("A", [Section("One", (Picture(ladder(RUNGS), "rungs"),))])
