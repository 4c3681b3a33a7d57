//! What a person or another program reads: tables, JSON, RINEX, NMEA, GeoJSON, KML, plots.
