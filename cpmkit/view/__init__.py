"""Pictures, films and interactive pages of solutions; no display and no OpenGL is needed."""

from __future__ import annotations

from cpmkit.view.pictures import Picture, check_picture, picture

__all__ = ["Picture", "check_picture", "picture"]
