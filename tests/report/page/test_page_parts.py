"""Parts of a page."""

import base64
import gzip

from plotly.offline import get_plotlyjs

from cmsreduce.report.page.page import packed_plotly


def test_the_plotting_library_is_whole() -> None:
    """It is read as a file, past the package, which says itself what is in it."""
    assert gzip.decompress(base64.b64decode(packed_plotly())).decode("utf-8") == get_plotlyjs()
