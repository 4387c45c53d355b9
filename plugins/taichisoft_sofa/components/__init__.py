"""The components of SOFA: a table with the translation of each type."""
