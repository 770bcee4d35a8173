"""The mechanism files that come with spherekit."""
