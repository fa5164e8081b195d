"""The one map over processes and clusters: every study that runs independent rows uses it.

    mapped            values of a task for each item, inside a study: rows run where the caller of the study says
    using             run the rows of all studies in a block in workers
    each              run a task for each item; yields every result as it comes, or in the order of the items
    Done              the result of one item, or its error
    WorkerDied        error of an item that ended three workers
    usable_cores      number of processes that `workers=None` starts
    connected         executor of the Dask cluster at an address

`workers` is a number of processes: 0 runs everything in this process, None starts one process per usable core.
`executor` runs the tasks elsewhere: any object with submit() as in concurrent.futures.Executor, or a Dask client.
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .cluster import connected as connected
    from .each import Done as Done, WorkerDied as WorkerDied, each as each
    from .mapped import mapped as mapped, using as using
    from .processes import usable_cores as usable_cores

public(__name__)
