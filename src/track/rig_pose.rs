//! Joint pose from all known tags (in the making).
