"""Pictures and videos with lines and captions, in the one style of all charts."""
