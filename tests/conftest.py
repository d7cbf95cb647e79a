"""Property tests draw the same examples on every run of the suite; a longer search is `--hypothesis-profile=search`."""

from hypothesis import settings

settings.register_profile("suite", max_examples=40, derandomize=True, deadline=None, database=None)
settings.register_profile("search", max_examples=2000, deadline=None)
settings.load_profile("suite")
