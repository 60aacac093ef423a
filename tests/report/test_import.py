import subprocess
import sys


def test_the_room_is_light_to_enter() -> None:
    heavy = "{'plotly', 'jinja2', 'matplotlib', 'rich'}"
    code = f"import sys, cmsreduce.report; sys.exit(', '.join({heavy} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
