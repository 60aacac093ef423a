"""Drafts of pipeline files from the files of bodies: which belong together, places to join, units, first frequencies.

Guesses that a user corrects belong here, each with its reason. Bodies that a run reads by its keys belong in
`pipeline.bodies`.
"""

from cmsreduce.pipeline.drafts.draft import Draft, draft_body, draft_pipeline

__all__ = ["Draft", "draft_body", "draft_pipeline"]
