"""Make the picture of the landing page and the README from a finished run of Galileo: `python docs/pictures.py`."""

from dataclasses import replace
from pathlib import Path

from cmsreduce.pipeline import reopen, run_result
from cmsreduce.report.pictures.charts import error_against_cost
from cmsreduce.report.pictures.still import draw_chart

HERE = Path(__file__).parent
# On a telephone, 370 pixels wide, the letters are ten pixels high.
INCHES = (4.6, 3.4)

if __name__ == "__main__":
    run = run_result(reopen(HERE.parent / "build" / "galileo"))
    draw_chart(replace(error_against_cost(run), inches=INCHES), HERE / "error-cost.png")
