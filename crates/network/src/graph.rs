//! An undirected graph of nodes and links.

use super::NetworkError;
use std::collections::VecDeque;

/// The links of the nine nodes of figure 5 of Khodabandeh & Teunissen 2019, numbered from 0; the figure's
/// constraint nodes are 0, 2, 3, 5 and 8.
pub const NINE_NODES: [(usize, usize); 12] = [
    (0, 1),
    (1, 2),
    (2, 4),
    (2, 5),
    (2, 6),
    (2, 7),
    (1, 3),
    (3, 4),
    (4, 5),
    (5, 6),
    (6, 8),
    (7, 8),
];

/// An undirected graph without loops; nodes are numbered from 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Graph {
    neighbours: Vec<Vec<usize>>,
}

impl Graph {
    /// The graph of `nodes` nodes with these links; a repeated link counts once.
    ///
    /// # Errors
    /// [`NetworkError::BadLink`] when a link leaves the network or joins a node with itself.
    pub fn new(nodes: usize, links: &[(usize, usize)]) -> Result<Self, NetworkError> {
        let mut neighbours = vec![Vec::new(); nodes];
        for &(a, b) in links {
            if a == b || a >= nodes || b >= nodes {
                return Err(NetworkError::BadLink(a, b, nodes));
            }
            neighbours[a].push(b);
            neighbours[b].push(a);
        }
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        Ok(Self { neighbours })
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.neighbours.len()
    }

    /// The neighbours of a node, ascending, without itself.
    pub fn neighbours(&self, node: usize) -> &[usize] {
        &self.neighbours[node]
    }

    /// Number of neighbours.
    pub fn degree(&self, node: usize) -> usize {
        self.neighbours[node].len()
    }

    /// Each link once, the smaller number first, ascending.
    pub fn links(&self) -> impl Iterator<Item = (usize, usize)> {
        let lists = self.neighbours.iter().enumerate();
        lists.flat_map(|(a, list)| list.iter().filter(move |&&b| a < b).map(move |&b| (a, b)))
    }

    /// Number of hops from a node to each node; `None` where there is no path.
    pub fn hops(&self, from: usize) -> Vec<Option<usize>> {
        let mut hops = vec![None; self.nodes()];
        hops[from] = Some(0);
        let mut queue = VecDeque::from([from]);
        while let Some(at) = queue.pop_front() {
            for &next in &self.neighbours[at] {
                if hops[next].is_none() {
                    hops[next] = hops[at].map(|h| h + 1);
                    queue.push_back(next);
                }
            }
        }
        hops
    }

    /// The largest number of hops from this node, and from there to here the next largest: None when the
    /// graph is not connected.
    fn eccentricity(&self, node: usize) -> Option<usize> {
        self.hops(node).into_iter().try_fold(0, |most, hops| hops.map(|h| most.max(h)))
    }

    /// The largest number of hops between two nodes; `None` when the graph is not connected.
    pub fn diameter(&self) -> Option<usize> {
        (0..self.nodes()).try_fold(0, |most, node| self.eccentricity(node).map(|e| most.max(e)))
    }

    /// The connected components, each ascending.
    pub fn parts(&self) -> Vec<Vec<usize>> {
        let mut part_of = vec![false; self.nodes()];
        let mut parts = Vec::new();
        for node in 0..self.nodes() {
            if part_of[node] {
                continue;
            }
            let hops = self.hops(node);
            let part: Vec<usize> = (0..self.nodes()).filter(|&k| hops[k].is_some()).collect();
            part.iter().for_each(|&k| part_of[k] = true);
            parts.push(part);
        }
        parts
    }

    /// That the graph is connected.
    ///
    /// # Errors
    /// [`NetworkError::Disconnected`].
    pub fn require_connected(&self) -> Result<(), NetworkError> {
        let parts = self.parts();
        match parts.iter().min_by_key(|part| part.len()) {
            Some(smallest) if parts.len() > 1 => {
                Err(NetworkError::Disconnected { parts: parts.len(), part: smallest.clone() })
            }
            _ => Ok(()),
        }
    }

    /// A spanning tree of few hops: breadth first from a node in the middle of the graph.
    ///
    /// # Errors
    /// [`NetworkError::Disconnected`].
    pub fn spanning_tree(&self) -> Result<Self, NetworkError> {
        self.require_connected()?;
        let middle = (0..self.nodes()).min_by_key(|&node| self.eccentricity(node));
        let mut links = Vec::new();
        if let Some(root) = middle {
            let hops = self.hops(root);
            for node in (0..self.nodes()).filter(|&node| node != root) {
                let parent = self.neighbours[node].iter().find(|&&k| hops[k] < hops[node]);
                links.extend(parent.map(|&parent| (parent, node)));
            }
        }
        Self::new(self.nodes(), &links)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_that_lead_nowhere_are_refused_and_doubles_count_once() {
        assert!(matches!(Graph::new(3, &[(0, 3)]), Err(NetworkError::BadLink(0, 3, 3))));
        assert!(matches!(Graph::new(3, &[(1, 1)]), Err(NetworkError::BadLink(1, 1, 3))));
        let graph = Graph::new(3, &[(0, 1), (1, 0), (2, 1)]).unwrap();
        assert_eq!(graph.links().collect::<Vec<_>>(), [(0, 1), (1, 2)]);
    }

    #[test]
    fn one_cut_link_is_noticed() {
        let ring: Vec<_> = (0..7).map(|k| (k, (k + 1) % 7)).collect();
        let graph = Graph::new(7, &ring[..6]).unwrap();
        assert_eq!(graph.diameter(), Some(6));
        let cut = Graph::new(7, &[&ring[..2], &ring[3..6]].concat()).unwrap();
        assert_eq!(cut.diameter(), None);
        let refused = cut.require_connected();
        assert_eq!(refused, Err(NetworkError::Disconnected { parts: 2, part: vec![0, 1, 2] }));
    }

    #[test]
    fn a_spanning_tree_of_a_ring_is_as_deep_as_half_the_ring() {
        let ring: Vec<_> = (0..9).map(|k| (k, (k + 1) % 9)).collect();
        let tree = Graph::new(9, &ring).unwrap().spanning_tree().unwrap();
        assert_eq!(tree.links().count(), 8);
        assert_eq!(tree.diameter(), Some(8));
    }
}
