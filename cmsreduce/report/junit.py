"""Findings of a check as JUnit XML, which continuous integration servers show as tests."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from cmsreduce.model.finding import Finding
from cmsreduce.report.finding_line import finding_line

__all__ = ["junit_xml"]

# Characters that XML 1.0 cannot hold in any form.
_FORBIDDEN = re.compile("[^\t\n\r -\ud7ff\ue000-�\U00010000-\U0010ffff]")


def junit_xml(findings: Sequence[Finding], checked: str) -> bytes:
    """One test case for each finding; what has no limit is skipped.

    Parameters
    ----------
    findings : sequence of Finding
    checked : str
        What was checked, the name of the test suite.

    Returns
    -------
    bytes
        UTF-8.
    """
    counts = {
        "tests": str(len(findings)),
        "failures": str(sum(not finding.passed for finding in findings)),
        "errors": "0",
        "skipped": str(sum(not finding.judged for finding in findings)),
    }
    root = ET.Element("testsuites", {"name": "cmsreduce check", **counts})
    suite = ET.SubElement(root, "testsuite", {"name": _text(f"cmsreduce check {checked}"), **counts, "time": "0"})
    for finding in findings:
        name = {"classname": _text(finding.subject or "run"), "name": _text(finding.check.name), "time": "0"}
        case = ET.SubElement(suite, "testcase", name)
        line = _text(finding_line(finding))
        if not finding.judged:
            ET.SubElement(case, "skipped", {"message": "no limit is set"})
        elif not finding.passed:
            ET.SubElement(case, "failure", {"message": line, "type": "limit"}).text = line
        ET.SubElement(case, "system-out").text = line
    ET.indent(root)
    body: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return body + b"\n"


def _text(text: str) -> str:
    return _FORBIDDEN.sub("?", text)
