"""The meshes, maps and scenes that texsss ships; each folder holds the script that makes it."""
