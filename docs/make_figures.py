"""Makes the pictures of the documentation again: ``python docs/make_figures.py [--story DIR] [--catalogue]``.

The tutorial's pictures are those that ``python -m controllers.study --chain`` writes; ``--story`` takes a folder in which
it has been played, otherwise it is played first. ``--catalogue`` draws the signature of every effect as well. Three
groups have commands of their own, named at the end: they need more than this machine's processor.
"""

from __future__ import annotations

import argparse
import io
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from pneuid.criticism.screening.signature import signature
from pneuid.effects import CATALOGUE
from pneuid.effects.__main__ import demonstration_rig
from pneuid.report.signature_figure import signature_figure
from pneuid.report.style import png

FOLDER = Path(__file__).with_name("figures")
DPI, COLORS = 90, 48
"""Of the catalogue's pictures, which are many and should stay small."""

STORY = {
    "ladder": "every_model_step", "ranking": "candidates", "tracking": "rms_tracking", "errors": "per_signal",
    "regions": "error_of_every_output", "friction": "steady_friction", "overlay": "measured_and_predicted",
}  # fmt: skip
"""Name in the documentation, and words that the file of the story's picture has in its name; the first such file counts."""

OTHERS = """made by their own commands:
  docs/study_2011  python -m pneuid.bench --out study
  docs/workbench   PNEUID_PICTURES=docs/workbench PNEUID_PICTURES_STUDY=study pytest tests/test_workbench_browser.py
  docs/control     python benchmarks/control_figures.py --out figures"""


def play(folder: Path) -> None:
    """The embedded story, into ``folder``."""
    subprocess.run([sys.executable, "-m", "controllers.study", "--chain", "--out", str(folder)], check=True)


def copy_story(story: Path) -> None:
    """The pictures of the tutorial. Exits with a sentence where the story has none of that name."""
    found = sorted((story / "figures").glob("[0-9][0-9]_*.svg"))
    for name, word in STORY.items():
        chosen = next((path for path in found if word in path.name), None)
        if chosen is None:
            sys.exit(
                f"{story}: no picture with '{word}' in its name; there are {', '.join(path.name for path in found)}"
            )
        shutil.copyfile(chosen, FOLDER / f"{name}.svg")
        print(f"{chosen.name} -> {FOLDER.name}/{name}.svg")


def draw_catalogue() -> None:
    """The signature of every effect, on the demonstration's rig."""
    folder = FOLDER / "catalogue"
    folder.mkdir(exist_ok=True)
    for name, effect in CATALOGUE.items():
        rig = demonstration_rig(effect)
        drawn = png(signature_figure(signature(effect, rig), rig.patm), DPI)
        Image.open(io.BytesIO(drawn)).convert("RGB").quantize(COLORS).save(folder / f"{name}.png", optimize=True)
        print(name, flush=True)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=re.sub(r"``", "", __doc__ or ""))
    parser.add_argument("--story", type=Path, metavar="DIR", help="a folder of controllers.study --chain")
    parser.add_argument("--catalogue", action="store_true", help="the signature of every effect too (minutes)")
    given = parser.parse_args()
    FOLDER.mkdir(exist_ok=True)
    if given.story is not None:
        copy_story(given.story)
    else:
        with tempfile.TemporaryDirectory() as made:
            play(Path(made) / "story")
            copy_story(Path(made) / "story")
    if given.catalogue:
        draw_catalogue()
    print(OTHERS)


if __name__ == "__main__":
    main()
