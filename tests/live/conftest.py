"""The live page of a module's `study`, and the browser that shows it. All modules share one browser, since it
takes seconds to begin."""

import live_studies
import pytest
from browser import browser

from cogless.live import write


@pytest.fixture(scope="session", autouse=True)
def keys_found_once():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cogless.live.live_page.adjustable", live_studies.found)
        yield


@pytest.fixture(scope="session")
def window(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("browser")) as shown:
        yield shown


@pytest.fixture(scope="module")
def path(study, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "live.html"
    write(study, path, "cogless run study.toml")
    return path
