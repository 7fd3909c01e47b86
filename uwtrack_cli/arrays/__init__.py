"""Sound of many hydrophones to beams: bearing-time record and peaks with bearings."""
