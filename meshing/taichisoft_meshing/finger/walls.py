"""The rules between a finger's dimensions: every wall of silicone must remain."""

from taichisoft_meshing.finger.dimensions import FingerDimensions

# [mm] A thinner wall cannot be cast, and its elements would be flat.
THINNEST_WALL = 0.1

# [mm] Sums of decimal fractions may miss by rounding.
ROUNDING = 1e-9

# More elements than any machine meshes and simulates in a sensible time.
MOST_ELEMENTS = 5_000_000


def check_walls(finger: FingerDimensions) -> None:
    """Raise ValueError, "key = value: what would be valid", for the first dimension that leaves no wall."""
    _check_taper(finger)
    _check_channel(finger)
    _check_chambers(finger)
    _check_slots(finger)
    _check_slots_miss_chambers(finger)
    _check_fillets(finger)
    _check_base(finger)
    _check_stiff_layer(finger)
    _check_sizes(finger)


def _check_taper(finger: FingerDimensions) -> None:
    body = finger.body
    at_most("body.tip_height", body.tip_height, body.height - THINNEST_WALL, "below body.height")
    at_most("body.taper_length", body.taper_length, body.length - THINNEST_WALL, "below body.length")


def _check_channel(finger: FingerDimensions) -> None:
    body, channel = finger.body, finger.channel
    at_least("channel.start", channel.start, THINNEST_WALL, "to leave a wall at the base")
    at_least("channel.end", channel.end, channel.start + THINNEST_WALL, "beyond channel.start")
    at_most("channel.end", channel.end, body.length - THINNEST_WALL, "to leave a wall at the tip")
    at_least("channel.top", channel.top, channel.bottom + THINNEST_WALL, "above channel.bottom")
    at_most("channel.top", channel.top, body.height - THINNEST_WALL, "to leave a wall at the back")
    at_most("channel.width", channel.width, body.width - 2 * THINNEST_WALL, "to leave walls at its sides")
    lowest = finger.underside(channel.end) + THINNEST_WALL
    at_least("channel.bottom", channel.bottom, lowest, "to leave a wall above the underside at channel.end")


def _check_chambers(finger: FingerDimensions) -> None:
    channel, chambers = finger.channel, finger.chambers
    last_end = chambers.first + (chambers.count - 1) * chambers.pitch + chambers.width
    if chambers.count > 1:
        at_least("chambers.pitch", chambers.pitch, chambers.width + THINNEST_WALL, "beyond chambers.width")
    at_least("chambers.first", chambers.first, channel.start, "channel.start")
    most = (channel.end - chambers.first - chambers.width) / chambers.pitch + 1
    if last_end > channel.end + ROUNDING:
        raise ValueError(
            f"chambers.count = {chambers.count}: the last chamber would end {last_end:g} mm from the base, "
            f"beyond channel.end = {channel.end:g}; must be at most {max(int(most + ROUNDING), 0)}"
        )
    widest = finger.body.width - 2 * THINNEST_WALL
    at_most("chambers.depth", chambers.depth, widest, "to leave walls at their sides")
    highest = channel.bottom - finger.underside(last_end) - THINNEST_WALL
    at_most("chambers.height", chambers.height, highest, "to leave a wall above the underside")


def _check_slots(finger: FingerDimensions) -> None:
    body, slots = finger.body, finger.slots
    if slots.count == 0:
        return
    at_least("slots.first", slots.first, THINNEST_WALL, "to leave a wall at the base")
    if slots.count > 1:
        at_least("slots.pitch", slots.pitch, slots.width + THINNEST_WALL, "beyond slots.width")
    last_end = slots.first + (slots.count - 1) * slots.pitch + slots.width
    flat = body.length - body.taper_length
    if last_end > flat + ROUNDING:
        raise ValueError(
            f"slots.count = {slots.count}: the last slot would end {last_end:g} mm from the base; "
            f"must end before the taper, which begins at {flat:g}"
        )
    above = finger.channel.bottom - THINNEST_WALL
    at_most("slots.depth", slots.depth, above, "to leave a wall below the channel")


def _check_slots_miss_chambers(finger: FingerDimensions) -> None:
    """A slot that reaches as high as the chambers must pass between them."""
    slots, chambers = finger.slots, finger.chambers
    reach = finger.channel.bottom - chambers.height - THINNEST_WALL
    if slots.depth <= reach + ROUNDING:
        return
    for slot in range(slots.count):
        near = slots.first + slot * slots.pitch
        for chamber in range(chambers.count):
            start = chambers.first + chamber * chambers.pitch
            gap = max(start - (near + slots.width), near - (start + chambers.width))
            if gap < THINNEST_WALL - ROUNDING:
                raise ValueError(
                    f"slots.depth = {slots.depth:g}: slot {slot + 1} ({near:g} to {near + slots.width:g} mm "
                    f"from the base) cuts into chamber {chamber + 1}, which begins at {start:g}; "
                    f"must be at most {reach:g}, or the slots must pass between the chambers"
                )


def _check_fillets(finger: FingerDimensions) -> None:
    """Between two fillets a flat face must remain, as between a fillet and the next edge."""
    slots, chambers = finger.slots, finger.chambers
    if slots.count:
        widest = (slots.width - THINNEST_WALL) / 2
        at_most("slots.fillet_radius", slots.fillet_radius, widest, "below half of slots.width")
        at_most("slots.fillet_radius", slots.fillet_radius, slots.depth - THINNEST_WALL, "below slots.depth")
    widest = (chambers.width - THINNEST_WALL) / 2
    at_most("chambers.fillet_radius", chambers.fillet_radius, widest, "below half of chambers.width")
    at_most("chambers.fillet_radius", chambers.fillet_radius, chambers.height - THINNEST_WALL, "below chambers.height")


def _check_base(finger: FingerDimensions) -> None:
    body, channel, inlet = finger.body, finger.channel, finger.inlet
    at_most("body.base_length", body.base_length, channel.start - THINNEST_WALL, "to end before the channel")
    if finger.slots.count:
        at_most("body.base_length", body.base_length, finger.slots.first - THINNEST_WALL, "to end before the slots")
    flat = body.length - body.taper_length
    at_most("body.base_length", body.base_length, flat - THINNEST_WALL, "to end before the taper")
    if inlet.diameter:
        room = min(channel.top - channel.bottom, channel.width) - 2 * THINNEST_WALL
        at_most("inlet.diameter", inlet.diameter, room, "to open into the near end of the channel")
        at_least("inlet.plug", inlet.plug, THINNEST_WALL, "to close the bore at the base")
        at_most("inlet.plug", inlet.plug, channel.start - THINNEST_WALL, "to leave a bore before channel.start")


def _check_stiff_layer(finger: FingerDimensions) -> None:
    body, layer = finger.body, finger.stiff_layer
    if layer.thickness == 0:
        return
    at_least("stiff_layer.end", layer.end, layer.start + THINNEST_WALL, "beyond stiff_layer.start")
    at_most("stiff_layer.end", layer.end, body.length, "body.length")
    at_most("stiff_layer.bottom", layer.bottom, body.height - THINNEST_WALL, "below body.height")
    at_most("stiff_layer.thickness", layer.thickness, body.height - layer.bottom, "body.height - stiff_layer.bottom")
    at_most("stiff_layer.width", layer.width, body.width, "body.width")


def _check_sizes(finger: FingerDimensions) -> None:
    sizes = finger.mesh
    at_most("mesh.largest", sizes.largest, finger.body.length, "body.length: elements larger than the body")
    at_most("mesh.smallest", sizes.smallest, sizes.largest, "mesh.largest")
    # A regular tetrahedron of edge s has the volume s^3 / (6 sqrt 2).
    regular = 8.5 * (finger.solid_volume - finger.cavity_volume)
    at_least("mesh.largest", sizes.largest, (regular / MOST_ELEMENTS) ** (1 / 3), "or the mesh would not end")


def at_least(key: str, value: float, low: float, why: str) -> None:
    """Raise ValueError, "key = value: must be at least low (why)", for a value below `low`."""
    if value < low - ROUNDING:
        raise ValueError(f"{key} = {value:g}: must be at least {low:g} ({why})")


def at_most(key: str, value: float, high: float, why: str) -> None:
    """Raise ValueError, "key = value: must be at most high (why)", for a value above `high`."""
    if value > high + ROUNDING:
        raise ValueError(f"{key} = {value:g}: must be at most {high:g} ({why})")
