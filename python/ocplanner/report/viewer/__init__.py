"""An episode in three dimensions, in the browser: record it, build its scene, serve it."""

from ocplanner.report.viewer.playback import Playback, record_playback
from ocplanner.report.viewer.server import Viewer, load_viser

__all__ = ["Playback", "Viewer", "load_viser", "record_playback"]
