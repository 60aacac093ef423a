"""Make the README's picture again from a finished run of the Galileo sample: `python docs/pictures.py`."""

from pathlib import Path

from cmsreduce.pipeline import reopen, run_result
from cmsreduce.report import response_picture

HERE = Path(__file__).parent
CONFIGURATION, CHANNEL = 2, (0, 0)  # spin = 45 deg; motor torque to gyro about x

if __name__ == "__main__":
    run = run_result(reopen(HERE.parent / "build" / "galileo"))
    response_picture(run, HERE / "galileo.png", CONFIGURATION, CHANNEL)
