"""The virtual rig: an independent truth that records what a real rig would.

It shares no equation and no integrator with the model that is identified from its recordings. The
rigs are described in ``truth``, what they hide in ``hidden``, in which form in ``forms``; ``recording`` and ``bench`` take
measurements, ``at_zero`` reads the sensors alone, ``servo`` is the plant of a control loop, ``files`` writes measurements down.
"""

from pneuid.virtual_rig.at_zero import record_zero
from pneuid.virtual_rig.bench import record_bench, steady_friction
from pneuid.virtual_rig.excitation import EXCITATIONS, Excitation
from pneuid.virtual_rig.files import write_csv
from pneuid.virtual_rig.forms import Form, drawn_form
from pneuid.virtual_rig.friction import FRICTION_2011, Friction
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.motion import MOTIONS, Motion, reciprocation, sine, strokes
from pneuid.virtual_rig.presets import BENCH_EFFECTS, HIDDEN_EFFECTS, OUTSIDE_EFFECTS, Outside, in_proportion, preset
from pneuid.virtual_rig.random_rigs import RandomBench, RandomServo, Sheet, random_bench, random_servo
from pneuid.virtual_rig.recording import record_command, record_servo
from pneuid.virtual_rig.sensors import BENCH_SENSORS, CONTROL_SENSORS, IDEAL_SENSORS, SERVO_SENSORS, Sensors
from pneuid.virtual_rig.servo import ServoPlant, run_open_loop
from pneuid.virtual_rig.truth import ATMOSPHERE, TruthBench, TruthServo

__all__ = [
    "ATMOSPHERE", "BENCH_EFFECTS", "BENCH_SENSORS", "CONTROL_SENSORS", "EXCITATIONS", "FRICTION_2011", "HIDDEN_EFFECTS",
    "IDEAL_SENSORS", "MOTIONS", "NOTHING", "OUTSIDE_EFFECTS", "SERVO_SENSORS", "Excitation", "Form", "Friction", "Hidden",
    "Motion", "Outside", "RandomBench", "RandomServo", "Sensors", "ServoPlant", "Sheet", "TruthBench", "TruthServo",
    "drawn_form", "in_proportion", "preset", "random_bench", "random_servo", "reciprocation", "record_bench", "record_command",
    "record_servo", "record_zero", "run_open_loop", "sine", "steady_friction", "strokes", "write_csv",
]  # fmt: skip
