"""Hooks of mkdocs.yml: pages outside docs/, and links as on GitHub.

The pages of the project link files of the source tree, which the site must have too, as it opens without a network.
Each linked file becomes a page under sources/, and so does each linked folder, as a list of its files.
"""

import pathlib

import site_api
import site_tree
from mkdocs.structure.files import File

_tree = None


def on_files(files, config):
    """Adds the pages of the root folder, the reference of the Python package, and every linked file."""
    global _tree
    root = pathlib.Path(config.config_file_path).resolve().parent
    docs = pathlib.Path(config.docs_dir).resolve().relative_to(root).as_posix()
    _tree = site_tree.Tree(root)
    for file in files:
        _tree.add(f"{docs}/{file.src_uri}", file.src_uri)
    for path, page in site_tree.ROOT_PAGES.items():
        if (root / path).exists():
            _tree.add(path, page)
            files.append(File.generated(config, page, abs_src_path=str(root / path)))
    written = {file.src_uri: file.content_string for file in files.documentation_pages()}
    for page, text in (site_api.pages(root / "python") | _tree.add_linked(written)).items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown, page, config, files):
    """Makes links to files of the tree links to their pages."""
    return _tree.rewritten(page.file.src_uri, markdown)
