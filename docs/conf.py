"""Sphinx: how the site is made. ``tools/docs.py`` lays the pages out and calls it."""

from importlib import metadata

project = "sjerk"
author = copyright = "the sjerk authors"
release = metadata.version("sjerk")
version = ".".join(release.split(".")[:2])
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
html_theme = "furo"
html_title = f"sjerk {release}"
html_static_path: list[str] = []
html_show_sphinx = False
myst_heading_anchors = 4
myst_enable_extensions = ["attrs_inline"]
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
pygments_style = "friendly"
exclude_patterns = ["_build"]
