"""Recordings as files for ParaView."""
