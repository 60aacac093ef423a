"""Findings as JUnit XML and Markdown, whatever their texts hold."""

import re
import xml.etree.ElementTree as ET

import pytest

from cmsreduce.model import Finding, Proof, judge
from cmsreduce.report import junit_xml, markdown_summary

FINDINGS = [
    Finding("kept_modes", 19, 18, "a <note> & more", subject="rotor"),
    Finding("frf_error", 0.01, float("inf")),
    Finding("odd \x01 name", float("nan"), 1.0, "line\nbreak | `code`", subject="pipe|body"),
    Finding("orthogonality in M", 0.0, 1e-10, subject="stator"),
]
PROOFS = [
    Proof("row order", "proven", 12.3, subject="rotor"),
    Proof("mass", "trusted", remark="on the word of the user", subject="rotor"),
    Proof("damping", "refuted", remark="a root grows"),
]
VERDICT = judge(FINDINGS, PROOFS, limited=True)


def test_junit_counts_what_a_server_counts() -> None:
    suite = ET.fromstring(junit_xml(FINDINGS, VERDICT, "build/<x>")).find("testsuite")
    cases = suite.findall("testcase")
    assert suite.get("name") == "cmsreduce check build/<x>"
    assert [suite.get(key) for key in ("tests", "failures", "errors", "skipped")] == ["7", "3", "0", "2"]
    kinds = [[child.tag for child in case if child.tag != "system-out"] for case in cases]
    assert kinds == [["failure"], ["skipped"], ["failure"], [], [], ["skipped"], ["failure"]]
    assert [case.get("classname") for case in cases] == ["rotor", "run", "pipe|body", "stator", "rotor", "rotor", "run"]
    assert next(each.get("value") for each in suite.iter("property")) == "FAIL"
    assert cases[0].find("failure").get("message") == "rotor: kept_modes: 19 (limit 18) - a <note> & more"
    assert "odd ? name" in cases[2].get("name")


def test_every_row_of_the_table_has_its_cells() -> None:
    text = markdown_summary(FINDINGS, VERDICT, "build/x")
    first = "1 limit is broken, 1 limit was not measured, 1 proof failed."
    assert text.startswith(f"## cmsreduce check build/x: FAIL\n\n{first}\n")
    assert "- trusted: mass of rotor: on the word of the user\n" in text
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    # Bars that are escaped end no cell.
    assert len(rows) == 6 and all(len(re.findall(r"(?<!\\)\|", row)) == 7 for row in rows)
    assert rows[1].startswith("| FAIL | rotor |")


@pytest.mark.parametrize(("limit", "verdict"), [(1.0, "pass"), (0.1, "FAIL"), (float("inf"), "info")])
def test_a_figure_without_a_limit_is_not_judged(limit: float, verdict: str) -> None:
    found = Finding("frf_error", 0.5, limit)
    assert (found.verdict, found.passed) == (verdict, verdict != "FAIL")
