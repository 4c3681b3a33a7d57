//! Nodes as processes of their own, on the loopback interface.

#[path = "node/files.rs"]
mod files;
#[path = "node/harness.rs"]
mod harness;
#[path = "node/processes.rs"]
mod processes;
