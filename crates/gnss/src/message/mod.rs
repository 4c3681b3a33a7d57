//! Navigation messages: from symbols to pages, and from pages to navigation data.

pub mod lnav;
