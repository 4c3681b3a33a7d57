//! Conditioning: the intermediate frequency removed and the level measured.
