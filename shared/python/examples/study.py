# %% [markdown]
# # A parameter study, on the local cores or on a cluster
# The table is the same wherever it is made; runs that cannot be built are rows with their error.

# %%
import os
import tempfile

import kingpin

runs = int(os.environ.get("KINGPIN_EXAMPLE_RUNS", "40"))


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        local = kingpin.sweep("quick", overrides={"sampling.runs": runs}, out=folder)
        print(local, sorted(os.listdir(folder)))
        # The same again: nothing is left to be made.
        assert kingpin.sweep("quick", overrides={"sampling.runs": runs}, out=folder).tasks == 0

    # %% The same on a cluster. On Slurm: dask_jobqueue.SLURMCluster instead of LocalCluster, see docs/PYTHON.md.
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        return
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        spread = kingpin.sweep("quick", overrides={"sampling.runs": runs}, client=client)
    assert spread.rows == local.rows
    print("the same table from the cluster, in", spread.tasks, "tasks")


if __name__ == "__main__":
    main()
