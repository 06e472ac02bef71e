"""The paper's 47 sentences, judged on one cohort of policies."""
