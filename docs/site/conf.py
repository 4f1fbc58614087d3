"""Configures Sphinx, which builds the site from the pages that pages.exs writes."""

from pygments.lexers.special import TextLexer

project = "Ganglion"
copyright = "the Ganglion authors"
extensions = ["myst_parser"]
root_doc = "index"
html_theme = "furo"
html_title = "Ganglion"
html_show_sphinx = False
html_copy_source = False
highlight_language = "text"

# Markdown as on GitHub and in IEx. Of MyST's own syntax, only directives are used.
myst_enable_extensions = ["linkify"]
myst_linkify_fuzzy_links = False
myst_disable_syntax = ["myst_line_comment", "myst_block_break", "myst_target", "myst_role"]
myst_heading_anchors = 6

# The text of a module may begin below the first heading level.
suppress_warnings = ["myst.header"]


def setup(app):
    # The dumps in docs/wire-format.md.
    app.add_lexer("hex", TextLexer)
