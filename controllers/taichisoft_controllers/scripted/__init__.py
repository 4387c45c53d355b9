"""The controller "scripted": files of keyframes or steps, and the conditions that steps wait for."""
