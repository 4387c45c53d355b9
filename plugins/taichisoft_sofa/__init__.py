"""SOFA's Python scenes without SOFA: what they build, and what becomes of it."""
