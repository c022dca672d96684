"""A scheduler of dask on this machine, and workers that SLURM starts; Enter ends them."""

from dask_jobqueue import SLURMCluster

cluster = SLURMCluster(
    queue="cpu",
    account="photonics",
    cores=1,  # of a job
    processes=1,  # one worker of one thread
    memory="2GB",
    walltime="04:00:00",
    local_directory="$TMPDIR",  # where a run is measured before it is put into its place
    job_script_prologue=["export LABCTL_DATA=/shared/data"],
    scheduler_options={"port": 8786},
)
cluster.scale(jobs=64)
print(cluster.scheduler_address)
input("Enter ends the workers\n")
