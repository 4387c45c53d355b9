"""The kind `pneunet_finger`: from its dimensions to a solid, and to tetrahedra."""
