"""JPEG pictures as cameras send them: where one ends, what its header says, its pixels as they are stored.

The one reader for every picture of a camera or a folder. Pixels are always the stored ones: an orientation in the EXIF
part is never applied, because boxes, calibrations and matches must speak of the same pixel.
"""
