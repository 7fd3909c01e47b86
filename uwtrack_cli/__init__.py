"""uwtrack: hydrophone recordings in, vessel tracks out."""

__version__ = "0.1.0"
