"""The analyses that come with spherekit, registered like any other plugin."""
