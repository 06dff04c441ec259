# pyright: strict
"""Certificates: bounds in a file that anyone can check in exact arithmetic, without this package."""

import subprocess
import sys
from pathlib import Path

import jhd

a = jhd.BezierCurve([(0, 0), (1, 2), (3, 2), (4, 0)])
b = jhd.polyline([(0, 0), (4, 0)])
solution = jhd.hausdorff(a, b)
certificate = jhd.certify(a, b, solution)
certificate.save("proof.json")
proven = certificate.verify()
print(proven)
assert proven.lower <= 1.5 and proven.upper is not None and 1.5 <= proven.upper

# The checker is a folder that needs only Python.
checker = str(Path(jhd.__file__).parent / "_distance/certificate/verification")
checked = subprocess.run([sys.executable, checker, "proof.json"], capture_output=True, text=True)
print(checked.stdout.strip())
assert checked.returncode == 0

# An invalid certificate is refused.
text = Path("proof.json").read_text()
Path("garbage.json").write_text(text[: len(text) // 2])
refused = subprocess.run([sys.executable, checker, "garbage.json"], capture_output=True)
assert refused.returncode != 0
