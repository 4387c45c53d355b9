"""SOFA scenes."""
