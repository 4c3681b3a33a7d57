//! The constraint nodes, whose stars bind all nodes to one solution.
//!
//! A constraint node s requires that itself and its neighbours, its *star*, agree. Khodabandeh & Teunissen
//! (Meas. Sci. Technol. 30 (2019) 044005) require of the set of constraint nodes that
//! - (18.1) each node is in a star, and
//! - (18.2) every two stars overlap, or both overlap with a third.
//!
//! The second is sufficient but not necessary. What is necessary is that the *overlap graph* of the stars
//! (two stars are joined where they share a node) is connected: [`Constraints::new`] requires that.
//! A simple sufficient rule is that each link of a connected graph has a constraint node at an end, which
//! [`choose`] fulfils with few nodes.

use super::{Graph, NetworkError};

/// A valid set of constraint nodes with its stars.
#[derive(Clone, Debug, PartialEq)]
pub struct Constraints {
    nodes: usize,
    hubs: Vec<usize>,
    hubs_of: Vec<Vec<usize>>,
    members: Vec<Vec<usize>>,
}

impl Constraints {
    /// A set of these constraint nodes.
    ///
    /// # Errors
    /// [`NetworkError::Disconnected`], or [`NetworkError::UnboundNodes`] when a node is in no star or the overlap
    /// graph of the stars is not connected.
    pub fn new(graph: &Graph, hubs: &[usize]) -> Result<Self, NetworkError> {
        graph.require_connected()?;
        let nodes = graph.nodes();
        let mut hubs = hubs.to_vec();
        hubs.sort_unstable();
        hubs.dedup();
        let unbound = |left| NetworkError::UnboundNodes { hubs: hubs.clone(), left };
        if let Some(&beyond) = hubs.last().filter(|&&hub| hub >= nodes) {
            return Err(unbound(format!("the network, which has no node {beyond}")));
        }
        let mut members = vec![Vec::new(); nodes];
        let mut hubs_of = vec![Vec::new(); nodes];
        for &hub in &hubs {
            members[hub] = graph.neighbours(hub).to_vec();
            members[hub].push(hub);
            members[hub].sort_unstable();
            members[hub].iter().for_each(|&node| hubs_of[node].push(hub));
        }
        let lonely: Vec<usize> = (0..nodes).filter(|&k| hubs_of[k].is_empty()).collect();
        if !lonely.is_empty() {
            return Err(unbound(format!("nodes {lonely:?} without a star")));
        }
        let constraints = Self { nodes, hubs, hubs_of, members };
        let parts = constraints.overlaps()?.parts().len();
        if parts > 1 {
            let left = format!("{parts} groups of stars that share no node");
            return Err(NetworkError::UnboundNodes { hubs: constraints.hubs, left });
        }
        Ok(constraints)
    }

    /// Number of nodes of the network.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// The constraint nodes, ascending.
    pub fn hubs(&self) -> &[usize] {
        &self.hubs
    }

    /// The constraint nodes whose stars hold this node (itself included where it is one), ascending: c_i of them.
    pub fn hubs_of(&self, node: usize) -> &[usize] {
        &self.hubs_of[node]
    }

    /// The star of a constraint node, itself included, ascending; empty for any other node.
    pub fn members(&self, hub: usize) -> &[usize] {
        &self.members[hub]
    }

    /// The overlap graph: its k-th node is the k-th constraint node's star.
    fn overlaps(&self) -> Result<Graph, NetworkError> {
        let overlap = |a: &usize, b: &usize| {
            self.members[*a].iter().any(|node| self.members[*b].binary_search(node).is_ok())
        };
        let count = self.hubs.len();
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
        let links: Vec<_> = pairs.filter(|&(a, b)| overlap(&self.hubs[a], &self.hubs[b])).collect();
        Graph::new(count, &links)
    }

    /// Condition (18.2) as printed: every two stars overlap, or both overlap with a third.
    pub fn printed_condition_holds(&self) -> bool {
        self.overlaps().is_ok_and(|overlaps| overlaps.diameter().is_some_and(|d| d <= 2))
    }

    /// That each link of the graph has a constraint node at an end.
    pub fn cover_every_link(&self, graph: &Graph) -> bool {
        let hub = |node| self.hubs.binary_search(&node).is_ok();
        graph.links().all(|(a, b)| hub(a) || hub(b))
    }
}

/// Chooses constraint nodes such that each link has one at an end: the neighbour of a node with a single open
/// link, else the node with most open links; then each that is not needed is dropped again.
///
/// # Errors
/// [`NetworkError::Disconnected`].
pub fn choose(graph: &Graph) -> Result<Constraints, NetworkError> {
    let mut chosen = vec![false; graph.nodes()];
    loop {
        let open = |node: usize| -> Vec<usize> {
            let free = graph.neighbours(node).iter().filter(|&&k| !chosen[k] && !chosen[node]);
            free.copied().collect()
        };
        let leaf = (0..graph.nodes()).map(open).find(|open| open.len() == 1);
        let widest = || (0..graph.nodes()).rev().max_by_key(|&node| open(node).len());
        match leaf.map(|open| open[0]).or_else(widest).filter(|&node| !open(node).is_empty()) {
            Some(node) => chosen[node] = true,
            None => break,
        }
    }
    for node in 0..graph.nodes() {
        chosen[node] &= !graph.neighbours(node).iter().all(|&k| chosen[k]);
    }
    let mut hubs: Vec<usize> = (0..graph.nodes()).filter(|&k| chosen[k]).collect();
    if hubs.is_empty() {
        hubs.extend((0..graph.nodes()).take(1));
    }
    Constraints::new(graph, &hubs)
}

/// Links without a common node: no fewer constraint nodes than these can stand at an end of every link.
pub fn matching(graph: &Graph) -> Vec<(usize, usize)> {
    let mut free = vec![true; graph.nodes()];
    let mut matched = Vec::new();
    let partners = |node: usize, free: &[bool]| -> Vec<usize> {
        graph.neighbours(node).iter().copied().filter(|&k| free[k] && free[node]).collect()
    };
    loop {
        let open = (0..graph.nodes()).map(|node| (node, partners(node, &free)));
        let fewest = open.filter(|(_, p)| !p.is_empty()).min_by_key(|(_, p)| p.len());
        let Some((node, partners)) = fewest else { return matched };
        free[node] = false;
        free[partners[0]] = false;
        matched.push((node, partners[0]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NINE_NODES;

    /// The nine nodes of the paper's figure 5, numbered from 0.
    fn nine() -> Graph {
        Graph::new(9, &NINE_NODES).unwrap()
    }

    #[test]
    fn sets_that_leave_a_node_or_a_group_out_are_refused() {
        let graph = nine();
        for hubs in [&[2][..], &[0, 8], &[]] {
            assert!(matches!(
                Constraints::new(&graph, hubs),
                Err(NetworkError::UnboundNodes { .. })
            ));
        }
        // A path of six: the stars of its ends' neighbours hold every node but share none.
        let path = Graph::new(6, &[(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)]).unwrap();
        assert!(Constraints::new(&path, &[1, 4]).is_err());
        assert!(Constraints::new(&path, &[1, 3, 4]).is_ok());
    }

    #[test]
    fn connected_stars_suffice_though_not_every_link_has_a_constraint_node() {
        let graph = nine();
        let four = Constraints::new(&graph, &[0, 2, 3, 8]).unwrap();
        assert!(!four.cover_every_link(&graph));
        assert!(Constraints::new(&graph, &[0, 2, 3, 5, 8]).unwrap().cover_every_link(&graph));
    }

    #[test]
    fn a_long_chain_of_stars_is_valid_though_the_printed_condition_fails() {
        let links: Vec<_> = (0..20).map(|k| (k, k + 1)).collect();
        let chain = Graph::new(21, &links).unwrap();
        let chosen = choose(&chain).unwrap();
        assert!(!chosen.printed_condition_holds());
        assert_eq!(chosen.hubs().len(), matching(&chain).len());
    }

    #[test]
    fn each_chosen_set_covers_every_link_and_none_is_smaller_than_a_matching() {
        let graph = nine();
        let chosen = choose(&graph).unwrap();
        assert!(chosen.cover_every_link(&graph));
        assert!(chosen.hubs().len() >= matching(&graph).len());
        for hub in chosen.hubs() {
            let rest: Vec<_> = chosen.hubs().iter().copied().filter(|k| k != hub).collect();
            assert!(
                !Constraints::new(&graph, &rest).is_ok_and(|rest| rest.cover_every_link(&graph))
            );
        }
    }
}
