"""The controllers that come with taichisoft."""
