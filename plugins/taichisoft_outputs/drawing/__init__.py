"""Pictures of recordings.

Throughout, points and vertices are in mm, of shape (count, 3); triangles are vertex indices, outward, (count, 3);
colours are red, green and blue from 0 to 1 [-]; a picture is an array (height, width, 3) of bytes, or in functions
`paint_...` a Pillow image in RGB, which is changed; `size` is width and height, and `letters` the height of letters
[pixels]; `radius` is that of the scene [mm]; `up` is the unit vector against gravity, `key` that to the key light,
and normals are unit vectors; `view` is a key of VIEW_DIRECTIONS; `aspect` is the width over the height of what things
are fitted into; `instants` are all that will be drawn, in order. Places in a picture are pixels to the right of its
left edge and below its upper edge. A recording stays open as long as it is drawn.
"""
