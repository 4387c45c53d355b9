"""Translation of the tree of a SOFA scene to the tables and files of a native scene."""
