"""What a run found, for people: on the terminal, as one HTML page, as a picture."""

from cmsreduce.report.page import render_report
from cmsreduce.report.page_parts import start_packing
from cmsreduce.report.picture import response_picture
from cmsreduce.report.terminal import print_summary

__all__ = ["print_summary", "render_report", "response_picture", "start_packing"]
