//! Nodes as processes of their own, on the loopback interface.

mod files;
mod harness;
mod processes;
