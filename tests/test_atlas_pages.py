"""Pages of the failure atlas: a summary, and a page for each group of scenes."""

from collections import Counter
from pathlib import Path

from atlas import scenes

PAGES = Path(__file__).parents[1] / "docs/benchmarks"


def test_every_topic_is_in_one_group():
    """Each module of scenes is in one group, because the groups are the only list of the modules."""
    modules = (f"atlas.scenes.{file.stem}" for file in Path(scenes.__file__).parent.glob("[!_]*.py"))
    assert Counter(topic.__name__ for topic in scenes.TOPICS) == Counter(modules)


def test_every_group_has_a_page_to_which_the_summary_links():
    assert {page.stem for page in (PAGES / "atlas").glob("*.md")} == scenes.GROUPS.keys()
    summary = (PAGES / "atlas.md").read_text()
    for name, (title, _) in scenes.GROUPS.items():
        assert f"[{title}](atlas/{name}.md)" in summary
        assert (PAGES / f"atlas/{name}.md").read_text().startswith(f"# {title}\n")


def test_the_summary_is_short():
    """A tenth of all pages of the atlas."""
    assert len((PAGES / "atlas.md").read_text().split()) < 5000
