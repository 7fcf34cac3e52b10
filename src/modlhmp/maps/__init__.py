"""Maps of dynamics: one module per map, which builds, loads and answers (contract: `maps.base`, `kinds.Kind`)."""
