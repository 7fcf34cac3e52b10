"""The paper's tables and figures: one module an exhibit, each drawn from the numbers it saves beside itself."""
