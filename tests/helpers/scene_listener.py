"""A recorder that keeps everything a run sends to it, for tests of recordings."""


class SceneListener:
    """A recorder of scenes that stores them in memory instead of a file.

    It has the two methods `start` and `log` that a run calls on its recorder.

    Attributes
    ----------
    scenes
        Scenes in the order in which they arrived.
    row_counts
        Number of samples of each scene.
    primitives_by_page
        Primitives (lines, points, texts, ...) of all scenes by the name of their page.
    samples_by_primitive
        Numbers of the samples at which a primitive was logged, by page and path.
    paths
        Paths of all primitives.
    logged
        Arguments of each call of `log`: page, samples, inputs, times.
    inputs, focus, row, properties, assembly_modes, times
        Attributes of the same names of the `RecordingHead` that `start` received.
    static_paths
        Paths of the primitives that do not change from sample to sample.
    """

    def __init__(self):
        self.scenes = []
        self.row_counts = []
        self.primitives_by_page = {}
        self.samples_by_primitive = {}
        self.paths = set()
        self.logged = []

    def start(self, head):
        """Store what a run announces to its recorder before the first scene (drawing).

        Parameters
        ----------
        head
            `RecordingHead` of the run.
        """
        self.inputs = head.inputs
        # Unit vector to the middle of the mechanism, where a viewer looks at the sphere.
        self.focus = head.focus
        # With two inputs the samples form a grid; this is the length of one of its rows.
        self.row = head.row
        # Words about the run by name, such as versions.
        self.properties = head.properties
        self.assembly_modes = head.assembly_modes
        self.times = head.times
        # Names of the drawn objects that do not change with the samples.
        self.static_paths = [
            primitive.path for scene in head.scenes for primitive in scene.primitives
        ]

    def log(self, scene, samples, inputs=None, times=None):
        """Store a scene: the primitives on one page, drawn for each of these samples."""
        self.scenes.append(scene)
        self.row_counts.append(len(samples))
        self.logged.append((scene.page, samples.tolist(), inputs, times))
        self.primitives_by_page.setdefault(scene.page, []).extend(scene.primitives)
        for primitive in scene.primitives:
            self.paths.add(primitive.path)
            key = (scene.page, primitive.path)
            self.samples_by_primitive.setdefault(key, []).extend(samples)

    def last_scene(self, page):
        """Return the last scene of a page and the number of its samples."""
        numbers = [k for k, scene in enumerate(self.scenes) if scene.page == page]
        return self.scenes[numbers[-1]], self.row_counts[numbers[-1]]

    def primitives(self, kind, page):
        """Return the primitives of a class on a page, by their paths."""
        primitives = self.primitives_by_page.get(page, ())
        return {p.path: p for p in primitives if isinstance(p, kind)}
