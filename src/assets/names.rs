//! Gives each of many things a name of its own.

use std::collections::HashMap;

/// Names that were given. The work is linear in their number, however many are equal.
#[derive(Debug, Default)]
pub struct UniqueNames {
    /// For each name the number that is tried next for another of its like.
    next: HashMap<String, usize>,
}

impl UniqueNames {
    /// The name itself; for one that was given before with a number: `Walk`, `Walk 2`, `Walk 3`.
    pub fn give(&mut self, name: String) -> String {
        let Some(first) = self.next.get(&name).copied() else {
            self.next.insert(name.clone(), 2);
            return name;
        };
        let mut number = first;
        let mut own = format!("{name} {number}");
        while self.next.contains_key(&own) {
            number += 1;
            own = format!("{name} {number}");
        }
        self.next.insert(name, number + 1);
        self.next.insert(own.clone(), 2);
        own
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn equal_names_are_numbered() {
        let mut names = UniqueNames::default();
        let given = ["Walk", "Walk 3", "Walk", "Walk", "Walk", "Run"].map(|n| names.give(n.into()));
        assert_eq!(given, ["Walk", "Walk 3", "Walk 2", "Walk 4", "Walk 5", "Run"]);
        let many: HashSet<String> = (0..20_000).map(|_| names.give("Walk".into())).collect();
        assert_eq!(many.len(), 20_000);
        assert!(many.iter().all(|name| name.len() <= "Walk 20010".len()));
    }
}
