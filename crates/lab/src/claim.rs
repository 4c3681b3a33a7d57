//! Claims of a paper, with the results here.

use std::fmt::Write;

/// A claim with its verdict.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    /// Figure, table or equation of the paper.
    pub place: &'static str,
    /// The claim.
    pub claim: String,
    /// The paper's value.
    pub paper: String,
    /// The value here.
    pub ours: String,
    /// Whether the value here confirms it.
    pub holds: bool,
}

impl Claim {
    fn verdict(&self) -> &'static str {
        if self.holds { "holds" } else { "does not hold" }
    }
}

/// The claims as a table for the terminal.
pub fn claim_table(claims: &[Claim]) -> String {
    let width = |text: fn(&Claim) -> &String| {
        claims.iter().map(|c| text(c).chars().count()).max().unwrap_or(0).max(5)
    };
    let (claim, paper, ours) = (width(|c| &c.claim), width(|c| &c.paper), width(|c| &c.ours));
    let mut text =
        format!("  {:6}  {:claim$}  {:paper$}  {:ours$}\n", "", "claim", "paper", "here");
    for c in claims {
        let _ = writeln!(
            text,
            "  {:6}  {:claim$}  {:paper$}  {:ours$}  {}",
            c.place,
            c.claim,
            c.paper,
            c.ours,
            c.verdict()
        );
    }
    text
}

/// The same as comma-separated values.
pub fn claim_csv(claims: &[Claim]) -> String {
    let plain = |text: &str| text.replace(',', ";");
    let mut text = String::from("place,claim,paper,here,verdict\n");
    for c in claims {
        let [claim, paper, ours] = [&c.claim, &c.paper, &c.ours].map(|t| plain(t));
        let _ = writeln!(text, "{},{claim},{paper},{ours},{}", c.place, c.verdict());
    }
    text
}
