"""An episode in three dimensions, in the browser: record it, build its scene, serve it."""

from ocplanner.report.viewer.playback import Playback, record_playback
from ocplanner.report.viewer.server import Viewer

__all__ = ["Playback", "Viewer", "record_playback"]
